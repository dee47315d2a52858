#!/usr/bin/env bash
# Breaks a copy of this folder in one place after another; check.sh has to call each of them wrong. Ends
# with the count.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"
make_scratch
trap 'rm -rf "$scratch"' EXIT

BRDFARM="$(find_program)" || { printf 'self-test: the program is not built; BRDFARM names it\n' >&2; exit 2; }
find_python || { printf 'self-test: PyYAML is not installed\n' >&2; exit 2; }
BRDFARM_SOURCE="$(cd "$deploy/.." && pwd)"
BRDFARM_PYTHON="$BRDFARM_SOURCE/target/python-clients"
export BRDFARM BRDFARM_SOURCE BRDFARM_PYTHON CHECK_OFFLINE=1
# A database is made only where it is what has to see a change.
export CHECK_WITHOUT_DATABASE=1
broken=0

# breaks SECTION FILE WHAT-IS-SAID SED: the section has to say that with this change in this file.
breaks() {
  local section="$1" file="$2" said="$3" change="$4" told="$scratch/told"
  rm -rf "$scratch/copy"
  mkdir "$scratch/copy"
  cp -r "$deploy" "$scratch/copy/deploy"
  sed -i -E "$change" "$scratch/copy/deploy/$file"
  if cmp -s "$deploy/$file" "$scratch/copy/deploy/$file"; then
    wrong "$file" "the change does not apply: $change"
    return
  fi
  broken=$((broken + 1))
  if "$scratch/copy/deploy/check.sh" "$section" > "$told" 2>&1; then
    wrong "$file" "not seen: $change"
  elif ! grep -q "^WRONG" "$told" || ! grep -qF "$said" "$told"; then
    cat "$told"
    wrong "$file" "seen, but not said ($said): $change"
  fi
}

# What only root can see, who can look as other users do.
as_root() { [[ "$(id -u)" != 0 ]] || "$@"; }

# What a database has to see.
with_database() {
  compgen -G '/usr/lib/postgresql/*/bin/initdb' > /dev/null || return 0
  CHECK_WITHOUT_DATABASE='' "$@"
}

coordinator=systemd/brdfarm-coordinator.service
worker=systemd/brdfarm-worker.service
breaks scripts slurm/workers.sbatch 'bash -n' '$ s/$/ "/'
# What the units did until somebody ran them.
as_root breaks systemd $coordinator 'cannot read /etc/brdfarm/credentials/coordinator' \
  's|\$\{CREDENTIALS_DIRECTORY\}|/etc/brdfarm/credentials/coordinator|'
as_root breaks systemd $worker 'cannot read /etc/brdfarm/worker' 's|\$\{CREDENTIALS_DIRECTORY\}|/etc/brdfarm/worker|'
as_root breaks systemd $coordinator 'nothing makes /etc/brdfarm/dataset.toml' '/dataset\.toml$/d'
as_root breaks systemd $coordinator 'cannot read /etc/brdfarm/dataset.toml' 's/-m 644 (.*dataset.toml)$/-m 600 \1/'
as_root breaks systemd $coordinator 'nothing makes /etc/brdfarm/credentials/coordinator/token' 's|tokens$|token|'
as_root breaks systemd $coordinator 'everybody reads /etc/brdfarm/credentials/operator/token' \
  's|^(#   )systemctl daemon-reload|\1chmod -R a+rX /etc/brdfarm|'
! command -v systemd-analyze > /dev/null || breaks systemd $coordinator 'systemd-analyze verify' 's/^ProtectHome=yes/ProtectHouse=yes/'
as_root breaks systemd $coordinator 'starts as a user without privileges' '/^LoadCredential=tokens/d'
as_root breaks systemd $worker 'EnvironmentFile: nothing makes' 's|^EnvironmentFile=.*|EnvironmentFile=/etc/brdfarm/work.env|'
as_root breaks systemd $worker 'everybody reads /etc/brdfarm/worker/key.pem' 's/-m 700/-m 755/; s/-m 600/-m 644/'
breaks slurm slurm/workers.sbatch 'where it looks' 's|^(#   install -m 600 worker/\* ~/.config/brdfarm)/worker|\1|'
breaks slurm slurm/workers.sbatch 'where it looks' 's|-m 600|-m 644|'

base=kubernetes/base
breaks kubernetes $base/kustomization.yaml 'TriggerAuthentication database: there is no Secret' \
  '/^configurations/,/names.yaml/d'
breaks kubernetes $base/worker.yaml 'replicas undo' 's/^  # No replicas.*/  replicas: 0/'
with_database breaks kubernetes $base/worker.yaml 'the autoscaler asks' 's/pending \+ disputed \+ checks/pending/; s/disputed \+ checks/0/'
breaks kubernetes $base/worker.yaml 'has no PASSWORD' 's/^      key: password/      key: PASSWORD/'
breaks kubernetes $base/worker.yaml 'there is no service farm with port 7117' 's|https://coordinator:|https://farm:|'
breaks kubernetes $base/worker.yaml 'nothing gives NODE' 's/- name: NODE/- name: POD/'
breaks kubernetes $base/worker.yaml 'cannot read credentials' 's/0440/0400/'
breaks kubernetes $base/coordinator.yaml 'everybody reads credentials' 's/0440/0444/'
breaks kubernetes $base/coordinator.yaml 'is not mounted' 's|mountPath: /etc/brdfarm/probe|mountPath: /etc/probe|'
breaks kubernetes $base/database-reader.yaml 'there is no ConfigMap brdfarm-reader' \
  's/name: brdfarm-database-reader/name: brdfarm-reader/'
with_database breaks kubernetes $base/database-reader.sql 'the autoscaler asks' 's/tallies, farm/tallies/'
with_database breaks kubernetes $base/database-reader.sql 'the reader reads tokens' 's/tallies, farm/tallies, farm, leases/'
breaks kubernetes $base/network.yaml 'selects no pod' 's/component: database-reader/component: reader/'
breaks kubernetes kubernetes/example/kustomization.yaml 'the autoscaler' 's/DATABASE_NAME=brdfarm/DATABASE_NAME=farm/'
breaks kubernetes kubernetes/example/kustomization.yaml 'others read' 's/umask 077/umask 022/'
breaks kubernetes kubernetes/example/kustomization.yaml 'has no tokens' '/keys\/coordinator\/tokens/d'
if command -v kubectl > /dev/null; then
  breaks kubernetes kubernetes/render.py 'the two renderings differ' \
    's/documents.append\(document\)/documents.append(document | {"immutable": True})/'
fi

breaks compose compose/compose.yaml 'no port of this machine leads to it' '/127\.0\.0\.1:711/d'
breaks compose compose/compose.yaml 'is open to other machines' 's/127\.0\.0\.1:7117/7117/'
breaks compose compose/compose.yaml 'names database, which is no service' 's|brdfarm@postgres/|brdfarm@database/|'
breaks compose compose/compose.yaml 'nothing mounts /run/keys' 's|worker:/run/keys:ro|worker:/keys:ro|'
as_root breaks compose compose/prepare.sh 'cannot read ./keys/' 's|chown -R "\$user" keys/coordinator|chown -R "\$user"|'
# What prepare.sh did.
as_root breaks compose compose/prepare.sh 'everybody reads keys/operator/token' '$ s/$/\nchmod -R a+rX keys/'
as_root breaks compose compose/prepare.sh 'containers'\'' user reads keys/operator' '$ s/$/\nchown -R 10001 keys || true/'
as_root breaks compose compose/prepare.sh 'everybody reads farm.env' 's/^umask 077/umask 022/; /^chmod -R go=/d'
! command -v cargo > /dev/null || breaks image Dockerfile.dockerignore 'cargo metadata' '/^!jobqueue$/d'

seen='each of %s breakages was seen'
((failed)) && seen='not all of %s breakages were seen'
[[ "$(id -u)" == 0 ]] || seen="$seen; root tries more"
# The two forms above.
# shellcheck disable=SC2059
printf "self-test: $seen\n" "$broken"
exit "$failed"
