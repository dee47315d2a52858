DELETE FROM sessions
WHERE seen_ms <= now_ms() - $1
    AND NOT EXISTS (SELECT FROM leases WHERE leases.worker = sessions.worker)
