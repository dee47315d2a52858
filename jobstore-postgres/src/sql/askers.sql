SELECT sessions.worker, sessions.name, workers.record, now_ms() - sessions.seen_ms,
    (SELECT count(*) FROM leases WHERE leases.worker = sessions.worker)
FROM sessions LEFT JOIN workers ON workers.name = sessions.name
WHERE sessions.worker = ANY ($1)
