//! The latent graph: k-means, edges, statistics, shortest paths.
