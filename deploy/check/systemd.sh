#!/usr/bin/env bash
# Checks the units: systemd knows every line, and after the commands at their heads the files that they
# name exist, the services' users read what they need, and nobody else does. systemd/try.sh runs them.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"
cd "$deploy/systemd"
make_scratch
trap 'rm -rf "$scratch"' EXIT

# Warnings about lines that systemd does not know count. It wants the program where the unit says.
verify() {
  local told
  sed 's|/usr/local/bin/brdfarm|/bin/true|' "$1" > "$scratch/$1"
  told="$(systemd-analyze verify --man=no "$scratch/$1" 2>&1)" && [[ -z "$told" ]] && return
  printf '%s\n' "$told"
  return 1
}

# Runs the commands at the head of a unit below a folder that stands for the root of the file system.
install_below() {
  local root="$1" unit="$2"
  commands_of "$unit" 1 | grep -Ev '^(useradd|systemctl) ' |
    sed "s|/etc/|$root/etc/|g; s|/usr/local/bin/|$root/bin/|g; s|target/release/brdfarm|$program|" \
      > "$scratch/commands"
  install -d -m 755 "$root/bin" "$root/etc/systemd/system"
  (cd "$deploy/.." && PATH="$root/bin:$PATH" bash -euo pipefail -c "cd '$scratch/at'
    $(sed "s|deploy/systemd/|$deploy/systemd/|g" "$scratch/commands")") > /dev/null
}

# Whether the user of a service reads a path, and if it is a folder all that is in it.
service_reads() {
  local path="$1" file
  setpriv --reuid "$service_user" --regid "$service_user" --clear-groups --bounding-set=-all \
    test -e "$path" || return 1
  while read -r file; do
    reads "$service_user" "$file" || return 1
  done < <(find "$path" -type f)
}

# What the unit names exists below the root, and its user reads it: the copies that systemd makes of
# credentials, and every path of its command.
check_paths() {
  local root="$1" unit="$2" name path word
  local given="$scratch/credentials-$unit"
  install -d -m 500 -o "$service_user" -g "$service_user" "$given"
  while IFS=: read -r name path; do
    if [[ -f "$root$path" ]]; then
      install -m 400 -o "$service_user" -g "$service_user" "$root$path" "$given/$name"
    else
      wrong "systemd/$unit" "LoadCredential: nothing makes $path"
    fi
  done < <(sed -n 's/^LoadCredential=//p' "$unit")
  while read -r path; do
    [[ -f "$root$path" ]] || wrong "systemd/$unit" "EnvironmentFile: nothing makes $path"
  done < <(sed -n 's/^EnvironmentFile=//p' "$unit")
  for word in $(sed -n '/^ExecStart=/,/[^\\]$/p' "$unit" | tr -d '\\'); do
    case "$word" in
      /etc/*) path="$root$word" ;;
      "\${CREDENTIALS_DIRECTORY}") path="$given" ;;
      *) continue ;;
    esac
    if [[ ! -e "$path" ]]; then
      wrong "systemd/$unit" "nothing makes $word"
    elif ! service_reads "$path"; then
      wrong "systemd/$unit" "the service cannot read $word"
    elif [[ -d "$path" && -z "$(ls "$path")" ]]; then
      wrong "systemd/$unit" "$word is empty"
    fi
  done
}

# Secrets are root's, or a service's, alone.
check_privacy() {
  local root="$1" file
  while read -r file; do
    if reads "$stranger" "$file"; then wrong systemd "everybody reads ${file#"$root"}"; fi
  done < <(find "$root/etc/brdfarm" -type f ! -name dataset.toml ! -name worker.env)
}

# What `brdfarm coordinator serve` says of what the unit gives it, as the unit's user.
coordinator_starts() {
  local root="$1"
  install -d -o "$service_user" -g "$service_user" "$scratch/state"
  timeout 20 setpriv --reuid "$service_user" --regid "$service_user" --clear-groups --no-new-privs \
    --inh-caps=-all --bounding-set=-all env -C "$scratch/state" "$root/bin/brdfarm" coordinator serve \
    --spec "$root/etc/brdfarm/dataset.toml" --store "$scratch/state/store" --listen 127.0.0.1:0 \
    --credentials "$scratch/credentials-brdfarm-coordinator.service" > "$scratch/told" 2>&1 &
  local process=$! tenths
  for ((tenths = 0; tenths < 150; tenths++)); do
    grep -q '^listening on https:' "$scratch/told" && break
    kill -0 "$process" 2> /dev/null || break
    sleep 0.1
  done
  kill "$process" 2> /dev/null || true
  wait "$process" 2> /dev/null || true
  grep -q '^listening on https:' "$scratch/told" || { cat "$scratch/told"; return 1; }
}

check_credentials() {
  local root="$scratch/root" unit before="$failed"
  install -d -m 755 "$root" "$root/etc" "$scratch/at"
  failed=0
  for unit in brdfarm-coordinator.service brdfarm-worker.service; do
    if ! install_below "$root" "$unit"; then
      wrong "systemd/$unit" 'the commands at its head fail'
      return
    fi
    # As whoever has both machines brings it over.
    [[ "$unit" == brdfarm-worker.service ]] ||
      cp -r "$(dirname "$(find "$root/etc/brdfarm" -path '*/worker/token')")" "$scratch/at/worker"
    check_paths "$root" "$unit"
  done
  check_privacy "$root"
  ((failed)) || checked 'systemd: credentials' 'the services read theirs, and nobody else does'
  ((failed)) || judge systemd/brdfarm-coordinator.service 'starts as a user without privileges' \
    coordinator_starts "$root"
  failed=$((failed | before))
}

if command -v systemd-analyze > /dev/null; then
  for unit in *.service; do
    judge "systemd/$unit" 'systemd-analyze verify' verify "$unit"
  done
else
  unchecked 'systemd/*.service' 'systemd-analyze is not installed'
fi
if [[ "$(id -u)" != 0 ]]; then
  unchecked 'systemd: credentials' 'only root can look as other users do'
elif ! program="$(find_program)"; then
  unchecked 'systemd: credentials' 'the program is not built; BRDFARM names it'
else
  check_credentials
fi
exit "$failed"
