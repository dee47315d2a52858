UPDATE sessions SET seen_ms = now_ms() WHERE worker = ANY ($1)
