//! MCAP traces of episodes.
