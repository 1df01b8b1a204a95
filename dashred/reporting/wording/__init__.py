"""The physical effect of terms, and the texts in the findings."""
