UPDATE sessions SET seen_ms = now_ms() WHERE worker = $1
