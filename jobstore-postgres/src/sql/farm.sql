SELECT mode, now_ms() FROM farm
