SELECT name, now_ms() - seen_ms FROM sessions WHERE worker = $1
