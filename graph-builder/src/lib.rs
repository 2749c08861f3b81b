//! Data set and encoder in, latent graph out.
