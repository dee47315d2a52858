SELECT pg_try_advisory_xact_lock(1651663975, hashtext(current_schema()))
