DELETE FROM sessions
WHERE worker = ANY ($1) AND seen_ms <= now_ms() - $2
    AND NOT EXISTS (SELECT FROM leases WHERE leases.worker = sessions.worker)
