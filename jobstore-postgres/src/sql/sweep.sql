SELECT swept_ms, now_ms(),
    EXISTS (SELECT FROM leases WHERE expires_ms <= now_ms())
    OR EXISTS (SELECT FROM workers WHERE barred AND bar_ends_ms <= now_ms())
FROM sweeps
