SELECT (SELECT count(*) FROM sessions WHERE seen_ms > now_ms() - $1),
    (SELECT count(*) FROM leases WHERE expires_ms > now_ms())
