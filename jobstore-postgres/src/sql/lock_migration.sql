SELECT pg_advisory_lock(1651663977, hashtext(current_schema()))
