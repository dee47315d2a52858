# What try.sh does inside the system that it boots; the functions install_* are the units' own
# commands. Not to be run by itself.
# shellcheck shell=bash disable=SC2164

say() { printf 'try-systemd: %s\n' "$*"; }
wrong() { printf 'try-systemd: WRONG: %s\n' "$*" >&2; exit 1; }

# Waits up to this many seconds until a command succeeds.
within() {
  local seconds="$1"
  for ((tenths = 0; tenths < seconds * 10; tenths++)); do
    if "${@:2}" > /dev/null 2>&1; then return 0; fi
    sleep 0.1
  done
  "${@:2}" || wrong "not within $seconds s: ${*:2}"
}

as_reader() {
  brdfarm status --coordinator "https://$(hostname -f):7117" \
    --credentials /etc/brdfarm/credentials/reader "$@"
}
has_completed() { as_reader --json | grep -q "\"completed\": *$1\b"; }
pid_of() { systemctl show --property MainPID --value "$1"; }
runs_again() { local now; now="$(pid_of "$1")"; [[ "$now" != 0 && "$now" != "$2" ]]; }

# The kernel's word for a service's hardening, not the unit's.
is_confined() {
  local service="$1" status
  status="/proc/$(pid_of "$service")/status"
  grep -q '^NoNewPrivs:[[:space:]]*1$' "$status" || wrong "$service may gain privileges"
  grep -q '^Seccomp:[[:space:]]*2$' "$status" || wrong "$service has no filter of system calls"
  grep -q '^CapBnd:[[:space:]]*0*$' "$status" || wrong "$service has capabilities in its bounding set"
  if grep -q '^Uid:[[:space:]]*0\b' "$status"; then wrong "$service runs as root"; fi
  say "$service runs as user $(stat --format %u "/proc/$(pid_of "$service")"), confined"
}

reads() { setpriv --reuid "$1" --regid 65534 --clear-groups cat "$2" > /dev/null 2>&1; }

# What a service may read, and neither everybody nor the other service.
try_reading() {
  local service="$1" other="$2" pid user file
  pid="$(pid_of "$service")"
  user="$(stat --format %u "/proc/$pid")"
  for file in /run/credentials/"$service".service/*; do
    nsenter --target "$pid" --mount setpriv --reuid "$user" --regid "$user" --clear-groups \
      cat "$file" > /dev/null || wrong "$service cannot read its $file"
    for reader in 65534 "$(stat --format %u "/proc/$(pid_of "$other")")"; do
      if reads "$reader" "$file"; then wrong "user $reader reads $file"; fi
    done
  done
  while read -r file; do
    for reader in 65534 "$user"; do
      if reads "$reader" "$file"; then wrong "user $reader reads $file, where only root is to"; fi
    done
  done < <(find /etc/brdfarm -type f ! -name dataset.toml ! -name worker.env)
  if tr '\0' '\n' < "/proc/$pid/environ" |
    grep -qFf <(cut -d ' ' -f 2 /etc/brdfarm/credentials/coordinator/tokens); then
    wrong "$service has a token in its environment"
  fi
  say "$service reads its credentials; neither $other nor everybody else does"
}

try_drain() {
  within 120 has_completed 20
  say 'a worker has rendered 20 materials for the coordinator'
}

# Both are killed, and come back by themselves.
try_kills() {
  local service pid
  for service in brdfarm-coordinator brdfarm-worker; do
    pid="$(pid_of "$service")"
    kill -KILL "$pid"
    within 30 runs_again "$service" "$pid"
  done
  within 30 has_completed 20
  say 'killed, both were started again, with all that was complete'
}

# Without the drop-in a coordinator must not start that was meant to ask for certificates.
try_mutual_tls() {
  systemctl stop brdfarm-worker brdfarm-coordinator
  rm -r /etc/brdfarm/credentials /etc/brdfarm/worker
  brdfarm credentials /etc/brdfarm/credentials --host "$(hostname -f)" --host farm.example.org --mutual-tls > /dev/null
  if systemctl start brdfarm-coordinator 2> /dev/null && systemctl is-active --quiet brdfarm-coordinator; then
    wrong 'the unit starts without the drop-in that --mutual-tls wants'
  fi
  cd /checkout
  install_mutual_tls
  within 20 has_completed 20
  mkdir /tmp/no-certificate
  cp /etc/brdfarm/credentials/reader/{token,authority.pem} /tmp/no-certificate/
  if brdfarm status --coordinator "https://$(hostname -f):7117" --credentials /tmp/no-certificate > /dev/null 2>&1; then
    wrong 'a client without a certificate is let in'
  fi
  say '--mutual-tls: refused to start without its drop-in; with it, a client without a certificate is refused'
}

try_stops() {
  systemctl stop brdfarm-worker brdfarm-coordinator
  local service result
  for service in brdfarm-coordinator brdfarm-worker; do
    result="$(systemctl show --property Result --value "$service")"
    [[ "$result" == success ]] || wrong "$service did not stop in order: $result"
  done
  [[ "$(brdfarm dataset verify --store /var/lib/brdfarm/store | tee /dev/stderr | wc -l)" -gt 0 ]]
  say 'stopped in order; the store is verified'
}

try_all() {
  printf '127.0.0.1 farm.example.org farm\n' >> /etc/hosts
  chmod 644 /etc/hosts
  hostname farm
  cd /checkout
  install_coordinator
  within 10 ask_coordinator
  # As whoever administers both machines brings it over.
  cp -r /etc/brdfarm/credentials/worker /root/worker
  mkdir /root/at-worker && cp -r deploy target /root/at-worker/ && mv /root/worker /root/at-worker/
  cd /root/at-worker
  install_worker
  try_drain
  is_confined brdfarm-coordinator
  is_confined brdfarm-worker
  try_reading brdfarm-coordinator brdfarm-worker
  try_reading brdfarm-worker brdfarm-coordinator
  try_kills
  try_stops
  systemctl start brdfarm-coordinator
  try_mutual_tls
}
