SELECT bytes FROM meshes WHERE digest = $1 AND part = $2
