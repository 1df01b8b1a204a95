"""The stages of one run, in the order of the story that ``dashred/train.py`` tells."""
