"""SHRED, its scaling and basis, and the two LightningModules that train and assimilate."""
