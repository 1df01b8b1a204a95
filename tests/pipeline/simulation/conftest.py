"""Settings of a short run."""

SHORT_RUN = """
shred: {lags: 5, latent: 8, decoder: [16], modes: 3, epochs: 2, steps: 4, batch: 8}
assimilation: {epochs: 2, width: 8}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 3}
surrogate: {members: 12}
threads: 1
tracking: {model: false}
"""
