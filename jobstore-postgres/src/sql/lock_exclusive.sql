SELECT pg_advisory_xact_lock(1651663974, hashtext(current_schema()))
