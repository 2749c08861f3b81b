//! The graph-builder: data set and encoder in, latent graph out.
