"""Maximum a posteriori estimate with latent forces: linearised model, Kalman filter, noise sizes."""
