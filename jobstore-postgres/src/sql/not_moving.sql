SELECT pg_try_advisory_xact_lock_shared(1651663977, hashtext(current_schema()))
