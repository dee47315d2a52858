UPDATE leases SET claimed_ms = $1, expires_ms = $2, views_done = 0, progressed_ms = $1
