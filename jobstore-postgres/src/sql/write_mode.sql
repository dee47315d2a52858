UPDATE farm SET mode = $1
