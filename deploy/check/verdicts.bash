# What the checks of this folder share. Sourced; leaves `failed` at 1 where something is wrong.
# shellcheck shell=bash disable=SC2034

deploy="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
failed=0
checked() { printf 'checked   %-34s %s\n' "$1" "$2"; }
unchecked() { printf 'UNCHECKED %-34s %s\n' "$1" "$2"; }
wrong() { printf 'WRONG     %-34s %s\n' "$1" "$2"; failed=1; }
judge() { if "${@:3}"; then checked "$1" "$2"; else wrong "$1" "$2"; fi; }

# The program, where it is built.
find_program() {
  local candidate
  for candidate in "${BRDFARM:-}" "$deploy"/../target/{release,debug}/brdfarm; do
    if [[ -n "$candidate" && -x "$candidate" ]]; then
      realpath "$candidate"
      return
    fi
  done
  return 1
}

# Python that has PyYAML: the system's, or with the readers that the tests install.
find_python() {
  if python3 -c 'import yaml' 2> /dev/null; then
    return
  fi
  export PYTHONPATH="${BRDFARM_PYTHON:-$deploy/../target/python-clients}"
  python3 -c 'import yaml' 2> /dev/null
}

# A folder that other users can pass through, but not list.
make_scratch() {
  scratch="$(mktemp -d)"
  chmod 711 "$scratch"
}

# The commands at the head of a file: its first block that is indented, or another.
commands_of() {
  awk -v wanted="$2" '!/^#/ { exit }
    /^#   / { if (!within) block++; within = 1; if (block == wanted) print substr($0, 5); next }
    { within = 0 }' "$1"
}

# Whether a user reads a file, with no group of anybody's and no privilege.
reads() {
  setpriv --reuid "$1" --regid "$1" --clear-groups --inh-caps=-all --bounding-set=-all \
    cat "$2" > /dev/null 2>&1
}

# Users that nobody is: in the range that systems hand to services only.
stranger=64999
service_user=64998
