#!/usr/bin/env bash
# Drains a farm by workers.sbatch for real: a Slurm cluster of one node from Debian's packages (munge,
# slurmctld, slurmd), a coordinator with TLS, and a user made for this, in whose home the commands at
# the head of workers.sbatch are followed word for word. Then cancels, signals and requeues workers in
# the middle of a second set. Nothing of it stays but the packages.
#
#   deploy/slurm/try.sh [PROGRAM]        # target/release/brdfarm
#
# Wants root and Debian or Ubuntu; takes two minutes.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
program="$(realpath "${1:-$here/../../target/release/brdfarm}")"

say() { printf 'try-slurm: %s\n' "$*"; }
fail() { printf 'try-slurm: %s\n' "$*" >&2; exit 1; }
[[ "$(id -u)" == 0 ]] || fail 'this wants root: it runs a cluster and makes a user'
[[ -x "$program" ]] || fail "there is no program $program: build it, or name one"
"$here/../install-packages.sh" slurmctld slurmd slurm-client munge

scratch="$(mktemp -d /var/tmp/try-slurm.XXXXXXXX)"
chmod 755 "$scratch"
user="try-slurm-$$"
home="$scratch/home"
processes=()
tear_down() {
  local status=$?
  if ((status)); then
    tail -n 15 "$scratch"/*.log "$home"/checkout/*.out >&2 2> /dev/null || true
  fi
  for ((index = ${#processes[@]} - 1; index >= 0; index--)); do
    kill "${processes[index]}" 2> /dev/null || true
    wait "${processes[index]}" 2> /dev/null || true
  done
  pkill -KILL -u "$user" 2> /dev/null || true
  userdel "$user" 2> /dev/null || true
  rm -rf "$scratch"
}
useradd --system --no-create-home --home-dir "$home" --shell /bin/bash "$user"
trap tear_down EXIT
install -d -o "$user" -g "$user" "$home"

# Waits up to this many seconds until a command succeeds.
within() {
  local seconds="$1"
  for ((tenths = 0; tenths < seconds * 10; tenths++)); do
    if "${@:2}" > /dev/null 2>&1; then return 0; fi
    sleep 0.1
  done
  "${@:2}" || fail "not within $seconds s: ${*:2}"
}
start() {
  "${@:2}" > "$scratch/$1.log" 2>&1 &
  processes+=("$!")
}
free_ports() {
  python3 - <<'PYTHON'
import socket
sockets = [socket.socket() for _ in range(3)]
for one in sockets:
    one.bind(("127.0.0.1", 0))
print(*(one.getsockname()[1] for one in sockets))
PYTHON
}
as_user() {
  setpriv --reuid "$user" --regid "$user" --init-groups --reset-env -- \
    env SLURM_CONF="$SLURM_CONF" HOME="$home" bash -euo pipefail -s
}

# One node, which says that it has the 32 cores that two tasks of workers.sbatch ask for.
start_cluster() {
  local node ports
  node="$(hostname -s)"
  read -ra ports < <(free_ports)
  install -d -m 755 -o munge -g munge "$scratch/munge"
  head -c 1024 /dev/urandom | install -m 400 -o munge -g munge /dev/stdin "$scratch/munge/key"
  start munged setpriv --reuid munge --regid munge --clear-groups munged --foreground \
    --key-file "$scratch/munge/key" --socket "$scratch/munge/socket" \
    --pid-file "$scratch/munge/pid" --seed-file "$scratch/munge/seed" --log-file "$scratch/munge/log"
  within 10 test -S "$scratch/munge/socket"
  mkdir -p "$scratch"/{state,spool}
  export SLURM_CONF="$scratch/slurm.conf"
  cat > "$SLURM_CONF" <<CONF
ClusterName=try
SlurmctldHost=$node(127.0.0.1)
SlurmctldPort=${ports[0]}
SlurmdPort=${ports[1]}
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$scratch/munge/socket
CredType=cred/munge
StateSaveLocation=$scratch/state
SlurmdSpoolDir=$scratch/spool
SlurmctldPidFile=$scratch/slurmctld.pid
SlurmdPidFile=$scratch/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,bf_interval=1
MinJobAge=600
KillWait=30
ReturnToService=2
NodeName=$node NodeAddr=127.0.0.1 CPUs=32 RealMemory=16384 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
  cat > "$scratch/cgroup.conf" <<< 'CgroupPlugin=cgroup/v1'
  start slurmctld slurmctld -D
  start slurmd slurmd -D
  within 30 idle_node
  say "$(sinfo --version): a cluster of one node runs"
}
idle_node() { [[ "$(sinfo --noheader --format %T)" == idle ]]; }

# A coordinator of a set; its port is the same each time.
start_coordinator() {
  "$program" coordinator serve --spec "$scratch/$1.toml" --store "$scratch/$1" \
    --listen "127.0.0.1:$port" --credentials "$scratch/keys/coordinator" \
    > "$scratch/coordinator-$1.log" 2>&1 &
  coordinator=$!
  processes+=("$coordinator")
  within 20 status_of
}
status_of() {
  "$program" status --coordinator "https://127.0.0.1:$port" --credentials "$scratch/keys/reader" --json
}
has() { status_of | grep -Eq "\"$1\": *$2\b"; }
queue_is_empty() { [[ -z "$(squeue --noheader)" ]]; }
runs() { [[ "$(squeue --noheader --states=RUNNING --array | wc -l)" -ge "$1" ]]; }

# The commands of workers.sbatch, with another URL and, second, another number of tasks.
commands() {
  sed -n 's/^#   //p' "$here/workers.sbatch" |
    sed "s|https://farm.example.org:7117|https://127.0.0.1:$port|; s|--array=1-64|--array=$1|"
}
# The last of them alone.
submit() {
  { printf 'cd ~/checkout\nexport PATH=~/.local/bin:"$PATH"\n' && commands "$1" | tail -n 1; } | as_user
}

check_store() {
  kill -TERM "$coordinator"
  wait "$coordinator" || fail 'the coordinator did not stop in order'
  "$program" dataset verify --store "$scratch/$1"
}

try_draining() {
  start_coordinator small
  { printf 'cd ~/checkout\n'; commands 1-6; } | as_user
  within 120 has completed 20
  within 60 queue_is_empty
  local ended
  ended="$(scontrol show job | grep -c 'JobState=COMPLETED .*' || true)"
  [[ "$ended" == 6 ]] || { scontrol show job >&2; fail "of 6 tasks $ended ended in order"; }
  say 'six tasks, two at a time, have rendered 20 materials and left'
  check_store small
  local open
  open="$(find "$home/.config" -type f -perm /077)"
  [[ -z "$open" ]] || fail "others read $open"
}

try_stopping() {
  start_coordinator large
  submit 1-2
  within 60 runs 2
  within 60 has_some
  local job
  job="$(squeue --noheader --format %F | head -n 1)"
  scancel "${job}_1"
  scancel --batch --signal=TERM "${job}_2"
  within 40 queue_is_empty
  has leased 0 || { status_of >&2; fail 'a lease was not handed back'; }
  say "cancelled and signalled, two workers handed back their leases: $(status_of | grep -o '"completed": *[0-9]*')"
  submit 1-1
  within 60 runs 1
  scontrol requeue "$(squeue --noheader --format %A | head -n 1)"
  within 300 has completed 20
  within 60 queue_is_empty
  if ! { has set_aside 0 && has leases_lost 0; }; then
    status_of >&2
    fail 'a job or a lease was lost'
  fi
  say 'a third, requeued while it worked, has rendered the rest'
  check_store large
}
has_some() { has completed '[1-9][0-9]*' && has leased '[1-9][0-9]*'; }

read -ra ports < <(free_ports)
port="${ports[2]}"
"$program" credentials "$scratch/keys" > /dev/null
printf 'name = "small"\nmaterials = 20\n[image]\nwidth = 16\nheight = 16\n' > "$scratch/small.toml"
printf 'name = "large"\nmaterials = 20\n[image]\nwidth = 64\nheight = 64\n' > "$scratch/large.toml"
mkdir "$home/checkout"
mkdir -p "$home/checkout/target/release"
cp -r "$here/.." "$home/checkout/deploy"
cp "$program" "$home/checkout/target/release/brdfarm"
cp -r "$scratch/keys/worker" "$home/checkout/worker"
chown -R "$user:$user" "$home"
start_cluster
try_draining
try_stopping
say 'drained, cancelled, signalled and requeued: nothing was lost'
