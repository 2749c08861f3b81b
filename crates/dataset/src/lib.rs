//! Offline episodes on disk and in memory.
