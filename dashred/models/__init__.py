"""SHRED, and the two LightningModules that train it and assimilate with it."""
