SELECT count(*), coalesce(sum(length(bytes)), 0)::bigint FROM meshes WHERE digest = $1
