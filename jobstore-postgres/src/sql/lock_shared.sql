SELECT pg_advisory_xact_lock_shared(1651663974, hashtext(current_schema()))
