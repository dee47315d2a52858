SELECT sessions.worker, sessions.name, worker.record, now_ms() - sessions.seen_ms,
    (SELECT count(*) FROM leases WHERE leases.worker = sessions.worker), answers.record
FROM sessions
    LEFT JOIN workers AS worker ON worker.name = sessions.name
    LEFT JOIN workers AS answers
        ON answers.name = identity(sessions.name) AND answers.name <> sessions.name
WHERE sessions.worker = ANY ($1)
