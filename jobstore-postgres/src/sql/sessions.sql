SELECT worker, name, (SELECT count(*) FROM leases WHERE leases.worker = sessions.worker)
FROM sessions
