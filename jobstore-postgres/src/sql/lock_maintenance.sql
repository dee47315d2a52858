SELECT pg_try_advisory_lock(1651663976, hashtext(current_schema()))
