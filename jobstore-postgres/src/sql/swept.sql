UPDATE sweeps SET swept_ms = $1
