#!/usr/bin/env bash
# Brings up compose.yaml for real: docker-compose over podman, a fresh user who runs prepare.sh in a
# home of his own, 20 materials, the status asked by that user on both coordinators, one of which is
# then killed. Images of PostgreSQL and SeaweedFS come from registries; without one, stand-ins/ has
# Debian's PostgreSQL and moto's S3 server behind the same names and command lines. The image of
# brdfarm is the Dockerfile's last stage with the program of this machine.
#
#   deploy/compose/try.sh [PROGRAM]        # target/release/brdfarm
#
# Wants root, Debian 12 and ports 7117 and 7118 of the loopback address. Takes three minutes.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
program="$(realpath "${1:-$here/../../target/release/brdfarm}")"
folder="${TRY_IMAGE_FOLDER:-/var/tmp/brdfarm-try}"

say() { printf 'try-compose: %s\n' "$*"; }
fail() { printf 'try-compose: %s\n' "$*" >&2; exit 1; }
[[ "$(id -u)" == 0 ]] || fail 'this wants root: it runs containers'
[[ -x "$program" ]] || fail "there is no program $program: build it, or name one"
"$here/../install-packages.sh" mmdebstrap buildah podman runc docker-compose python3-pip \
  golang-github-containernetworking-plugin-dnsname

scratch="$(mktemp -d)"
chmod 711 "$scratch"
user="try-compose-$$"
home="$scratch/home"
processes=()
storage=(--root "$scratch/storage" --runroot "$scratch/run" --storage-driver overlay)
engine() { podman "${storage[@]}" "$@"; }
tear_down() {
  local status=$? process
  if ((status)); then
    engine ps --all >&2 || true
    engine logs compose_coordinator_1 2>&1 | tail -n 5 >&2 || true
  fi
  compose down --volumes --timeout 5 > /dev/null 2>&1 || true
  for process in "${processes[@]}"; do
    kill "$process" 2> /dev/null || true
    wait "$process" 2> /dev/null || true
  done
  engine rm --force --all > /dev/null 2>&1 || true
  umount --recursive "$scratch/storage/overlay" 2> /dev/null || true
  userdel "$user" 2> /dev/null || true
  rm -rf "$scratch"
}
within() {
  local tenths
  for ((tenths = 0; tenths < $1 * 10; tenths++)); do
    if "${@:2}" > /dev/null 2>&1; then return; fi
    sleep 0.1
  done
  fail "not within $1 s: ${*:2}"
}
as_user() {
  setpriv --reuid "$user" --regid "$user" --clear-groups env -C "$home/brdfarm" HOME="$home" "$@"
}
compose() { docker-compose -f "$home/brdfarm/deploy/compose/compose.yaml" "$@"; }
status() {
  as_user target/release/brdfarm status --coordinator "https://localhost:$1" \
    --credentials deploy/compose/keys/reader "${@:2}"
}
finished() { status "$1" --json | grep -Eq '"completed": *20\b'; }

make_images() {
  local base="$folder/debian-slim.tar" image
  mkdir -p "$folder" "$scratch/brdfarm/out" "$scratch/empty"
  if [[ ! -e "$base" ]]; then
    say 'making a Debian'
    mmdebstrap --quiet --variant=minbase trixie "$base.new.tar" \
      "${DEBIAN_MIRROR:-http://deb.debian.org/debian}" 2> "$base.log" || { cat "$base.log" >&2; exit 1; }
    mv "$base.new.tar" "$base"
  fi
  engine import --quiet "$base" docker.io/library/debian:trixie-slim > /dev/null
  cp -r "$here/stand-ins" "$scratch/"
  python3 -m pip --quiet --disable-pip-version-check install --root-user-action=ignore \
    --target "$scratch/stand-ins/s3/site" --python-version 3.13 --only-binary=:all: 'moto[server,s3]==5.*' 2> /dev/null
  install --strip "$program" "$scratch/brdfarm/out/brdfarm"
  tac "$here/../Dockerfile" | sed '/^FROM /q' | tac > "$scratch/brdfarm/Dockerfile"
  build docker.io/library/brdfarm:latest --build-context "build=$scratch/brdfarm" \
    --file "$scratch/brdfarm/Dockerfile" "$scratch/empty"
  for image in postgres s3; do
    build "$(image_of "$image")" "$scratch/stand-ins/$image"
  done
}
# The image of a service, by its full name.
image_of() {
  awk -v service="  $1:" '$0 == service { within = 1 } within && $1 == "image:" {
    print "docker.io/" ($2 ~ "/" ? "" : "library/") $2; exit }' "$here/compose.yaml"
}
build() {
  buildah "${storage[@]}" build --isolation chroot --pull-never --network host --tag "$@" \
    > "$scratch/told" 2>&1 || { tail -n 20 "$scratch/told" >&2; fail "building $1"; }
}

# podman leaves health checks to systemd, which may not be there.
check_health() {
  while sleep 2; do
    for container in compose_postgres_1 compose_s3_1; do
      engine healthcheck run "$container" > /dev/null 2>&1 || true
    done
  done
}

cat > "$scratch/containers.conf" <<'CONF'
[containers]
default_ulimits = ["nofile=4096:4096", "nproc=4096:4096"]
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
CONF
export CONTAINERS_CONF="$scratch/containers.conf" DOCKER_HOST="unix://$scratch/podman.sock"
useradd --system --no-create-home --home-dir "$home" "$user"
trap tear_down EXIT
make_images
podman "${storage[@]}" system service --time 0 "$DOCKER_HOST" > "$scratch/service" 2>&1 &
processes+=("$!")
check_health &
processes+=("$!")
within 20 test -S "$scratch/podman.sock"

mkdir -p "$home/brdfarm/target/release"
cp -r "$here/.." "$home/brdfarm/deploy"
cp "$program" "$home/brdfarm/target/release/brdfarm"
chown -R "$user:" "$home"
as_user env BRDFARM=target/release/brdfarm deploy/compose/prepare.sh
# What a user changes first.
printf 'name = "compose"\nmaterials = 20\n[image]\nwidth = 16\nheight = 16\n' > "$home/brdfarm/deploy/compose/dataset.toml"
# As compose.yaml says, but for --build: the image is there.
compose up --no-build --detach --scale worker=4 > "$scratch/told" 2>&1 || { cat "$scratch/told" >&2; fail 'up'; }
within 30 status 7117
within 120 finished 7118
say 'two coordinators and four workers have rendered 20 materials'
status 7117
engine kill compose_coordinator_1 > /dev/null
status 7118 > /dev/null
say 'one coordinator was killed; the other answers'
open="$(find "$home/brdfarm/deploy/compose" -maxdepth 3 -type f -perm /077 ! -name '*.yaml' ! -name '*.sh' ! -name .gitignore ! -path '*/stand-ins/*')"
[[ -z "$open" ]] || fail "others read $open"
