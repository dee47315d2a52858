#!/usr/bin/env bash
# Checks kubernetes/: renders the example with kubernetes/render.py and, where it is, with kubectl, and
# looks whether names resolve in what comes out. Where there is PostgreSQL the autoscaler's statement
# runs too, as the role that the job makes: kubernetes/try-autoscaler.sh. CHECK_OFFLINE=1 leaves out
# what wants a package from PyPI, CHECK_WITHOUT_DATABASE=1 PostgreSQL.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"
make_scratch
trap 'rm -rf "$scratch"' EXIT

if ! find_python; then
  unchecked kubernetes 'PyYAML is not installed'
  exit "$failed"
fi

# A copy with what its head tells to make, but for what an editor and a cluster do.
cp -r "$deploy/kubernetes" "$scratch/"
example="$scratch/kubernetes/example"
program="$(find_program || true)"
follow_head() {
  mkdir "$scratch/bin"
  ln -s "$program" "$scratch/bin/brdfarm"
  (cd "$example" && PATH="$scratch/bin:$PATH" bash -euo pipefail -c \
    "$(commands_of kustomization.yaml 1 | grep -Ev '^(kubectl|"\$\{EDITOR)')") > /dev/null
}
if [[ -n "$program" ]]; then
  judge kubernetes 'the commands at the head of the example' follow_head
  open="$(find "$example/keys" "$example"/*.env -type f -perm /077)"
  [[ -z "$open" ]] || wrong kubernetes "others read $open"
else
  unchecked kubernetes 'the program is not built, BRDFARM names it: keys are empty files'
  for file in "$example"/*.env.example; do
    cp "$file" "${file%.example}"
  done
  mkdir -p "$example"/keys/{coordinator,worker}
  touch "$example"/keys/coordinator/{certificate.pem,key.pem,tokens} \
    "$example"/keys/worker/{authority.pem,token}
fi

check="$deploy/kubernetes/check.py"
if python3 "$deploy/kubernetes/render.py" "$example" > "$scratch/rendered.yaml"; then
  judge kubernetes 'names resolve, as render.py renders it' python3 "$check" "$scratch/rendered.yaml"
else
  wrong kubernetes 'render.py'
fi
if ! command -v kubectl > /dev/null; then
  unchecked kubernetes 'kubectl is not installed: render.py renders as it does'
elif kubectl kustomize "$example" > "$scratch/kustomized.yaml"; then
  judge kubernetes 'kubectl kustomize: names resolve' \
    python3 "$check" "$scratch/kustomized.yaml" --same-as "$scratch/rendered.yaml"
else
  wrong kubernetes 'kubectl kustomize'
fi

if [[ -n "${CHECK_OFFLINE:-}" ]]; then
  unchecked 'kubernetes: schemas' 'CHECK_OFFLINE is set'
else
  python3 -m venv "$scratch/python"
  if "$scratch/python/bin/pip" install -q kubernetes-validate==1.37.0; then
    # Kinds of KEDA have schemas of their own, which the package has not.
    "$scratch/python/bin/python" "$check" "$scratch/rendered.yaml" --core > "$scratch/core.yaml"
    judge 'kubernetes: core kinds' 'kubernetes-validate, strict' \
      "$scratch/python/bin/kubernetes-validate" --strict --quiet "$scratch/core.yaml"
    unchecked "kubernetes: kinds of KEDA" 'no schema of KEDA here'
  else
    unchecked 'kubernetes: schemas' 'kubernetes-validate could not be installed'
  fi
fi

if [[ -n "${CHECK_WITHOUT_DATABASE:-}" ]]; then
  unchecked 'kubernetes: the autoscaler asks' 'CHECK_WITHOUT_DATABASE is set'
elif ! compgen -G '/usr/lib/postgresql/*/bin/initdb' > /dev/null; then
  unchecked 'kubernetes: the autoscaler asks' 'PostgreSQL is not installed'
elif [[ -z "$program" ]]; then
  unchecked 'kubernetes: the autoscaler asks' 'the program is not built; BRDFARM names it'
else
  python3 "$check" "$scratch/rendered.yaml" --query > "$scratch/query.sql"
  judge 'kubernetes: the autoscaler asks' 'a real PostgreSQL, as brdfarm_reader' \
    "$deploy/kubernetes/try-autoscaler.sh" "$program" "$scratch/query.sql"
fi
exit "$failed"
