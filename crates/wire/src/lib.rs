//! Every message between processes, over iceoryx2.
