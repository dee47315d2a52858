SELECT farm.mode, now_ms(), sessions.name, workers.record,
    (SELECT count(*) FROM leases WHERE leases.worker = $1)
FROM farm
LEFT JOIN sessions ON sessions.worker = $1
LEFT JOIN workers ON workers.name = sessions.name
