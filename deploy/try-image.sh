#!/usr/bin/env bash
# Builds the last stage of Dockerfile with buildah over a Debian that mmdebstrap makes here, and runs a
# farm in containers of it with podman, confined as compose.yaml confines them: a coordinator, two
# workers, and 20 materials with TLS. The stage before it, which compiles for long, is not run: the
# program of this machine takes the place of what it makes. Nothing stays but packages and the Debian.
#
#   deploy/try-image.sh [PROGRAM]        # target/release/brdfarm
#
# Wants root and Debian or Ubuntu. The Debian stays in TRY_IMAGE_FOLDER (/var/tmp/brdfarm-try).
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
program="$(realpath "${1:-$here/../target/release/brdfarm}")"
folder="${TRY_IMAGE_FOLDER:-/var/tmp/brdfarm-try}"

say() { printf 'try-image: %s\n' "$*"; }
fail() { printf 'try-image: %s\n' "$*" >&2; exit 1; }
[[ "$(id -u)" == 0 ]] || fail 'this wants root: it runs containers'
[[ -x "$program" ]] || fail "there is no program $program: build it, or name one"
"$here/install-packages.sh" mmdebstrap buildah podman runc

scratch="$(mktemp -d)"
# Images and containers of its own, beside any that are here. runc, for crun wants another layout of
# cgroups than some machines have; limits, for a machine may not let them be raised.
storage=(--root "$scratch/storage" --runroot "$scratch/run" --storage-driver "${TRY_IMAGE_DRIVER:-overlay}")
engine() { podman "${storage[@]}" --runtime runc "$@"; }
confined() {
  engine run --ulimit nofile=4096:4096 --ulimit nproc=4096:4096 --read-only --tmpfs /tmp \
    --cap-drop ALL --security-opt no-new-privileges "$@"
}
tear_down() {
  local status=$?
  if ((status)); then
    engine logs coordinator 2> /dev/null | tail -n 5 >&2 || true
  fi
  engine rm --force --all > /dev/null 2>&1 || true
  umount --recursive "$scratch/storage/overlay" 2> /dev/null || true
  rm -rf "$scratch"
}
trap tear_down EXIT

base="$folder/debian-slim.tar"
mkdir -p "$folder"
if [[ ! -e "$base" ]]; then
  say 'making a Debian'
  mmdebstrap --quiet --variant=minbase trixie "$base.new.tar" \
    "${DEBIAN_MIRROR:-http://deb.debian.org/debian}" 2> "$base.log" || { cat "$base.log" >&2; exit 1; }
  mv "$base.new.tar" "$base"
fi
engine import --quiet "$base" docker.io/library/debian:trixie-slim > /dev/null

# The last stage, word for word; `build` is a folder in the place of the stage before.
mkdir -p "$scratch/build/out" "$scratch/empty"
install --strip "$program" "$scratch/build/out/brdfarm"
tac "$here/Dockerfile" | sed '/^FROM /q' | tac > "$scratch/Dockerfile"
grep -q '^COPY --from=build /out/brdfarm' "$scratch/Dockerfile" || fail 'the last stage copies no program'
buildah "${storage[@]}" build --isolation chroot --pull-never --network host \
  --build-context "build=$scratch/build" --file "$scratch/Dockerfile" --tag brdfarm "$scratch/empty" \
  > "$scratch/told" 2>&1 || { tail -n 20 "$scratch/told" >&2; fail 'buildah'; }
say "built: $(confined --rm brdfarm --version)"

told="$(confined --rm --entrypoint sh brdfarm -c 'id -u; ldconfig -p | grep -c libembree4; touch /file 2>&1 || true')"
[[ "$told" == *$'\n'* && "${told%%$'\n'*}" == 10001 ]] || fail "it does not run as user 10001: $told"
[[ "$(sed -n 2p <<< "$told")" -ge 1 ]] || fail 'Embree is not installed in it'
[[ "$told" == *'Read-only file system'* ]] || fail 'the root of its file system can be written'

# Keys as compose/prepare.sh makes them where root runs it.
cp -r "$here/compose" "$scratch/compose"
rm -rf "$scratch"/compose/{keys,farm.env,dataset.toml}
BRDFARM="$program" "$scratch/compose/prepare.sh"
keys="$scratch/compose/keys"
printf 'name = "image"\nmaterials = 20\n[image]\nwidth = 16\nheight = 16\n' > "$scratch/compose/dataset.toml"
install -d -o 10001 -g 10001 -m 700 "$scratch/store"

confined --detach --name coordinator --publish 127.0.0.1::7117 \
  --volume "$keys/coordinator:/run/keys:ro" --volume "$scratch/store:/store" \
  --volume "$scratch/compose/dataset.toml:/etc/brdfarm/dataset.toml:ro" \
  brdfarm coordinator serve --spec=/etc/brdfarm/dataset.toml --store=/store/images \
  --listen=0.0.0.0:7117 --credentials=/run/keys > /dev/null
port="$(engine port coordinator 7117)"
status() { "$program" status --coordinator "https://localhost:${port##*:}" --credentials "$keys/reader" "$@"; }
for _ in {1..100}; do
  status > /dev/null 2>&1 && break
  sleep 0.1
done
status > /dev/null || fail 'the published port does not lead to the coordinator'
for number in 1 2; do
  # In the coordinator's network, where it is localhost.
  confined --detach --name "worker-$number" --network container:coordinator \
    --volume "$keys/worker:/run/keys:ro" \
    brdfarm worker connect https://localhost:7117 --name "worker-$number" --credentials=/run/keys > /dev/null
done
for number in 1 2; do
  [[ "$(engine wait "worker-$number")" == 0 ]] || fail "worker-$number: $(engine logs "worker-$number" 2>&1)"
done
status --json | grep -Eq '"completed": *20\b' || fail "not all was rendered: $(status)"
engine stop --time 30 coordinator > /dev/null
[[ "$(engine inspect --format '{{.State.ExitCode}}' coordinator)" == 0 ]] || fail 'the coordinator did not stop in order'
"$program" dataset verify --store "$scratch/store/images"
say 'a coordinator and two workers in containers have rendered 20 materials'
