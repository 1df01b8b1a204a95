"""The networks alone: SHRED and its assimilation, with each part switched off."""
