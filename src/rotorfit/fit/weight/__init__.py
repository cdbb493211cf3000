"""k_t by the weight that thrust carries, and by changes of thrust."""
