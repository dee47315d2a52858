#!/usr/bin/env bash
# Runs both units for real, with their hardening: boots a Debian system with systemd as its first
# process in a container without a network, installs coordinator and worker there with the commands
# that stand at the head of the units, word for word, and lets them render 20 materials. Then it
# looks at who can read which credential, kills what runs, and tries --mutual-tls.
#
#   deploy/systemd/try.sh [PROGRAM]        # target/release/brdfarm
#
# Wants root and Debian or Ubuntu. Takes two minutes, one of them to make the system, which stays in
# TRY_SYSTEMD_FOLDER (/var/tmp/brdfarm-try) for the next time. TRY_SYSTEMD_SUITE=bookworm takes Debian
# 12, and TRY_SYSTEMD_UMASK=077 another mask than 022 for those who install.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
program="$(realpath "${1:-$here/../../target/release/brdfarm}")"
suite="${TRY_SYSTEMD_SUITE:-trixie}"
folder="${TRY_SYSTEMD_FOLDER:-/var/tmp/brdfarm-try}"

say() { printf 'try-systemd: %s\n' "$*"; }
fail() { printf 'try-systemd: %s\n' "$*" >&2; exit 1; }
[[ "$(id -u)" == 0 ]] || fail 'this wants root: it boots a system of its own'
[[ -x "$program" ]] || fail "there is no program $program: build it, or name one"

"$here/../install-packages.sh" systemd-container
"$here/../debian-root.sh" "$suite" "$folder/$suite" \
  systemd systemd-sysv dbus ca-certificates procps

scratch="$(mktemp -d)"
leader=''
stop_system() {
  if [[ -n "$leader" ]]; then
    # SIGRTMIN+4 asks systemd to power off.
    kill -RTMIN+4 "$leader" 2> /dev/null || true
    wait "$container" 2> /dev/null || true
  fi
  rm -rf "$scratch"
}
trap stop_system EXIT

# What a checkout looks like to whoever installs.
checkout="$scratch/checkout"
mkdir -p "$checkout/target/release"
cp -r "$here/.." "$checkout/deploy"
cp "$program" "$checkout/target/release/brdfarm"

systemd-nspawn --quiet --directory="$folder/$suite" --volatile=overlay --private-network --boot \
  --register=no --keep-unit --hostname=farm --machine="brdfarm-try-$$" \
  --bind-ro="$checkout:/checkout" > "$scratch/console" 2>&1 < /dev/null &
container=$!
for _ in {1..100}; do
  leader="$(pgrep --parent "$container" --oldest || true)"
  [[ -n "$leader" ]] && break
  sleep 0.1
done
[[ -n "$leader" ]] || { cat "$scratch/console"; fail 'the system did not start'; }

# Runs a script from standard input in the system.
inside() { nsenter --target "$leader" --all -- env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root bash -euo pipefail -s; }
for _ in {1..300}; do
  state="$(inside <<< 'systemctl is-system-running || true' 2> /dev/null || true)"
  [[ "$state" == running || "$state" == degraded ]] && break
  sleep 0.1
done
[[ "$state" == running || "$state" == degraded ]] || {
  tail -n 20 "$scratch/console"
  fail "the system has not booted: $state"
}
say "systemd $(inside <<< "systemctl --version | sed -n '1s/[^(]*(\(.*\)).*/\1/p'") runs as the first process"

# The commands at the head of a unit: its first block, or its second.
commands() {
  awk -v wanted="$2" '/^\[Unit\]/ { exit }
    /^#   / { if (!within) block++; within = 1; if (block == wanted) print substr($0, 5); next }
    { within = 0 }' "$here/$1"
}

{
  cat "$here/try-inside.sh"
  # The one word that is changed: a smaller set.
  printf 'install_coordinator() {\n%s\n}\n' "$(commands brdfarm-coordinator.service 1 |
    sed 's/materials = 60/materials = 20\\n[image]\\nwidth = 16\\nheight = 16/')"
  printf 'ask_coordinator() {\n%s\n}\n' "$(commands brdfarm-coordinator.service 2)"
  printf 'install_worker() {\n%s\n}\n' "$(commands brdfarm-worker.service 1)"
  printf 'install_mutual_tls() {\n%s\n}\n' "$(commands mutual-tls.conf 1)"
  printf 'umask %s\ntry_all\n' "${TRY_SYSTEMD_UMASK:-022}"
} > "$scratch/script"
if ! inside < "$scratch/script"; then
  inside <<< 'journalctl --no-pager --lines 40 --unit "brdfarm-*"' >&2 || true
  fail 'the units do not hold what they promise'
fi
say 'both units hold what they promise'
