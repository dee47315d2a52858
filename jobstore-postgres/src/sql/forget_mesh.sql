DELETE FROM meshes WHERE digest = $1
