#!/usr/bin/env bash
# Checks compose/: names resolve, docker compose reads the file, and after prepare.sh the containers'
# user reads what is mounted into them, and nobody else does.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"
make_scratch
trap 'rm -rf "$scratch"' EXIT
yaml="$deploy/compose/compose.yaml"

# Makes a copy and prepares it as some user.
prepare_as() {
  local user="$1" folder="$scratch/as-$1"
  install -d -o "$user" -g "$user" "$folder"
  install -o "$user" -g "$user" "$deploy"/compose/{compose.yaml,prepare.sh} "$folder/"
  env -C "$folder" HOME="$folder" BRDFARM="$program" PATH="$PATH" \
    setpriv --reuid "$user" --regid "$user" --clear-groups ./prepare.sh
}

# A container's user sees the mounted folder and nothing above it: the engine mounts as root.
container_reads() {
  local user="$1" mounted="$2" file
  local -a files
  mapfile -t files < <(find "$mounted" -type f)
  ((${#files[@]})) || return 1
  mkdir -p "$scratch/mount"
  for file in "${files[@]}"; do
    [[ -f "$mounted" ]] && file="$scratch/mounted-file" || file="$scratch/mount${file#"$mounted"}"
    touch "$scratch/mounted-file"
    # The commands within get the paths as arguments.
    # shellcheck disable=SC2016
    unshare --mount bash -c '
      if [[ -d "$2" ]]; then mount --bind "$2" "$3/mount"; else mount --bind "$2" "$3/mounted-file"; fi
      setpriv --reuid "${1%%:*}" --regid "${1##*:}" --clear-groups --bounding-set=-all cat "$4" > /dev/null
    ' - "$user" "$mounted" "$scratch" "$file" 2> /dev/null || return 1
  done
}

check_prepared() {
  local maker="$1" folder="$scratch/as-$1" user service path file before="$failed"
  failed=0
  if ! prepare_as "$maker"; then
    wrong "compose, prepared by user $maker" 'prepare.sh fails'
    return
  fi
  user="$(sed -n 's/^BRDFARM_USER=//p' "$folder/.env")"
  while read -r service path; do
    container_reads "$user" "$folder/$path" ||
      wrong "compose, prepared by user $maker" "user $user of service $service cannot read $path"
  done < <(python3 "$deploy/check/compose.py" "$yaml" --mounts)
  while read -r file; do
    if reads "$stranger" "$file"; then
      wrong "compose, prepared by user $maker" "everybody reads ${file#"$folder/"}"
    fi
    # Only a container of whoever made it could, and none mounts these.
    if [[ "$file" == */keys/@(authority|operator|reader)/* && "$maker" == 0 ]] && reads "${user%%:*}" "$file"; then
      wrong "compose, prepared by user $maker" "the containers' user reads ${file#"$folder/"}"
    fi
  done < <(find "$folder" -type f ! -name '*.sh' ! -name compose.yaml ! -name dataset.toml)
  ((failed)) || checked "compose, prepared by user $maker" \
    "user $user of the containers reads what they mount, and nobody else does"
  failed=$((failed | before))
}

if find_python; then
  judge compose/compose.yaml 'names resolve; ports of this machine alone' \
    python3 "$deploy/check/compose.py" "$yaml"
  if [[ "$(id -u)" != 0 ]]; then
    unchecked 'compose: credentials' 'only root can look as other users do'
  elif ! program="$(find_program)"; then
    unchecked 'compose: credentials' 'the program is not built; BRDFARM names it'
  else
    # Where every user reaches it.
    install -m 755 "$program" "$scratch/brdfarm"
    program="$scratch/brdfarm"
    check_prepared 0
    check_prepared "$service_user"
  fi
else
  unchecked compose 'PyYAML is not installed'
fi

install -d "$scratch/read"
cp "$yaml" "$scratch/read/"
touch "$scratch/read/"{farm.env,database.secret,s3.json,dataset.toml}
export BRDFARM_USER=1:1
if docker compose version > /dev/null 2>&1; then
  judge compose/compose.yaml 'docker compose config' \
    docker compose -f "$scratch/read/compose.yaml" config --quiet
elif command -v docker-compose > /dev/null; then
  judge compose/compose.yaml 'docker-compose config' \
    docker-compose -f "$scratch/read/compose.yaml" config --quiet
else
  unchecked compose/compose.yaml 'docker compose is not installed'
fi
exit "$failed"
