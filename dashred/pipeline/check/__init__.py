"""What is wrong or doubtful about a system and a recording, before any analysis of them."""
