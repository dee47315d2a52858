#!/usr/bin/env bash
# Reads every file of this folder as its engine would, as far as that can be done without the engine:
# ends with what was checked by what, and what was not. README.md says what that leaves open.
set -euo pipefail
cd "$(dirname "$0")"

failed=0
checked() { printf 'checked   %-34s %s\n' "$1" "$2"; }
unchecked() { printf 'UNCHECKED %-34s %s\n' "$1" "$2"; }
wrong() { printf 'WRONG     %-34s %s\n' "$1" "$2"; failed=1; }
judge() { if "${@:3}"; then checked "$1" "$2"; else wrong "$1" "$2"; fi; }

scripts=(*.sh compose/*.sh slurm/*.sbatch)
for script in "${scripts[@]}"; do
  judge "$script" 'bash -n' bash -n "$script"
done
if command -v shellcheck > /dev/null; then
  judge "${#scripts[@]} scripts" shellcheck shellcheck --severity=warning "${scripts[@]}"
else
  unchecked "${#scripts[@]} scripts" 'shellcheck is not installed'
fi

scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
if command -v systemd-analyze > /dev/null; then
  # It wants the program where the unit says.
  for unit in systemd/*.service; do
    sed 's|/usr/local/bin/brdfarm|/bin/true|' "$unit" > "$scratch/${unit##*/}"
    judge "$unit" 'systemd-analyze verify' systemd-analyze verify --man=no "$scratch/${unit##*/}"
  done
else
  unchecked 'systemd/*.service' 'systemd-analyze is not installed'
fi

if command -v sbatch > /dev/null && sinfo > /dev/null 2>&1; then
  judge slurm/workers.sbatch 'sbatch --test-only' \
    env COORDINATOR=http://localhost:7117 sbatch --test-only slurm/workers.sbatch
else
  unchecked slurm/workers.sbatch 'there is no Slurm here'
fi

if command -v kubectl > /dev/null; then
  cp -r kubernetes "$scratch/"
  cd "$scratch/kubernetes/example"
  for example in *.env.example; do
    cp "$example" "${example%.example}"
  done
  mkdir -p keys/{coordinator,worker}
  touch keys/coordinator/{certificate.pem,key.pem,tokens} keys/worker/{authority.pem,token}
  cd "$OLDPWD"
  if kubectl kustomize "$scratch/kubernetes/example" > "$scratch/rendered.yaml"; then
    checked kubernetes 'kubectl kustomize'
    python3 -m venv "$scratch/python"
    if "$scratch/python/bin/pip" install -q kubernetes-validate==1.37.0; then
      # Kinds of KEDA have schemas of their own, which the package has not.
      "$scratch/python/bin/python" - "$scratch/rendered.yaml" "$scratch" <<'PYTHON'
import sys, yaml
ours = {False: [], True: []}
for document in yaml.safe_load_all(open(sys.argv[1])):
    ours[document["apiVersion"].startswith("keda.sh/")].append(document)
yaml.safe_dump_all(ours[False], open(f"{sys.argv[2]}/core.yaml", "w"))
print(*[document["kind"] for document in ours[True]], file=open(f"{sys.argv[2]}/keda", "w"))
PYTHON
      judge "kubernetes: core kinds" 'kubernetes-validate, strict' \
        "$scratch/python/bin/kubernetes-validate" --strict --quiet "$scratch/core.yaml"
      unchecked "kubernetes: $(cat "$scratch/keda")" 'no schema of KEDA here'
    else
      unchecked kubernetes 'kubernetes-validate could not be installed'
    fi
  else
    wrong kubernetes 'kubectl kustomize'
  fi
else
  unchecked kubernetes 'kubectl is not installed'
fi

mkdir -p "$scratch/compose/keys"
cp compose/compose.yaml "$scratch/compose/"
touch "$scratch/compose/"{farm.env,database.secret,s3.json,dataset.toml}
if docker compose version > /dev/null 2>&1; then
  judge compose/compose.yaml 'docker compose config' \
    docker compose -f "$scratch/compose/compose.yaml" config --quiet
elif command -v docker-compose > /dev/null; then
  judge compose/compose.yaml 'docker-compose config' \
    docker-compose -f "$scratch/compose/compose.yaml" config --quiet
else
  unchecked compose/compose.yaml 'docker compose is not installed'
fi

if command -v docker > /dev/null && docker info > /dev/null 2>&1; then
  judge Dockerfile 'docker build --check' docker build --check -f Dockerfile ..
else
  unchecked Dockerfile 'no container engine runs here'
fi
exit "$failed"
