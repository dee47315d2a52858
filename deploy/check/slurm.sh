#!/usr/bin/env bash
# Checks slurm/workers.sbatch as far as a cluster is at hand; slurm/try.sh makes one and drains a farm.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"

if command -v sbatch > /dev/null && sinfo > /dev/null 2>&1; then
  judge slurm/workers.sbatch 'sbatch --test-only' \
    env COORDINATOR=http://localhost:7117 sbatch --test-only "$deploy/slurm/workers.sbatch"
else
  unchecked slurm/workers.sbatch 'there is no Slurm cluster here; slurm/try.sh makes one'
fi

# What the head tells to install is where the script looks, and nobody else reads it.
make_scratch
trap 'rm -rf "$scratch"' EXIT
private() {
  local home="$scratch/home" file
  mkdir -p "$home/checkout/target/release" "$home/checkout/worker"
  touch "$home/checkout/target/release/brdfarm" "$home/checkout/worker/token"
  (cd "$home/checkout" && HOME="$home" bash -euo pipefail -c \
    "$(commands_of "$deploy/slurm/workers.sbatch" 1 | grep -v '^sbatch ')") || return 1
  file="$(sed -n 's|^credentials=.*\$HOME\(.*\)}"$|\1|p' "$deploy/slurm/workers.sbatch")"
  [[ -n "$file" && -f "$home$file/token" && -x "$home/.local/bin/brdfarm" ]] || return 1
  [[ -z "$(find "$home$file" -perm /077)" ]]
}
judge slurm/workers.sbatch 'the commands at its head put the credentials where it looks' private
exit "$failed"
