#!/usr/bin/env bash
# One farm with its images in an emulator's bucket, from its first upload to its removal. Writes a
# line for each step, `step<TAB>outcome<TAB>detail`, into the file RESULTS, and stops at the first
# step that fails.
#
#   tests/buckets/try.sh PROVIDER UNDISTURBED RESULTS
#
# UNDISTURBED is a store of the same specification that a local run made, its specification beside
# it as spec.toml. Runs in the current folder, which is empty. BRDFARM names the program, and
# FARM_FAULTS the tests of tests/farm_faults, built.
set -euo pipefail

provider="$1"
undisturbed="$2"
results="$3"
root="$(cd "$(dirname "$0")/../.." && pwd)"
source "$root/tests/buckets/providers.sh"

step=start
processes=()
detail=""

finish() {
  local status=$?
  ((status == 0)) || printf '%s\tFAILED\t%s\n' "$step" "see $PWD" >>"$results"
  for process in "${processes[@]}"; do kill "$process" 2>/dev/null || true; done
  stop_emulators
}
trap finish EXIT

# do_step NAME: runs the function of that name. `detail` is what it found.
do_step() {
  step="$1"
  detail=""
  "$step" >"$step.log" 2>&1
  printf '%s\tok\t%s\n' "$step" "$detail" >>"$results"
}

# says LOG TEXT: whether a command's output has a text.
says() {
  grep -qF -- "$2" "$1" || {
    echo "expected in $1: $2" >&2
    return 1
  }
}

# Compares a store with the undisturbed one: labels and digests by the bytes of the manifest, the
# images behind the digests by verify.
equals_undisturbed() {
  "$BRDFARM" dataset manifest export --store "$1" --format parquet --out "$1.parquet"
  cmp "$1.parquet" "$undisturbed.parquet"
  "$BRDFARM" dataset verify --store "$1"
}

start() { "start_$provider"; }

# The workers get no environment: they have no key of the bucket, only signed URLs.
farm() {
  local address=""
  : >coordinator.log
  "$BRDFARM" coordinator serve --spec "$(dirname "$undisturbed")/spec.toml" --store farm \
    --blobs "$url/a/set" --listen 127.0.0.1:0 --exit-when-complete >coordinator.log 2>&1 &
  local coordinator=$!
  processes+=("$coordinator")
  for _ in {1..100}; do
    address="$(sed -n 's/^listening on //p' coordinator.log)"
    [[ -n "$address" ]] && break
    sleep 0.1
  done
  local workers=()
  for name in one two; do
    env -i PATH="$PATH" HOME="$HOME" "$BRDFARM" worker connect "$address" --name "$name" \
      --threads 1 >"worker-$name.log" 2>&1 &
    workers+=($!)
  done
  processes+=("${workers[@]}")
  for process in "${workers[@]}" "$coordinator"; do wait "$process"; done
  processes=()
  equals_undisturbed farm
}

# Every image came by a signed URL.
signed() {
  local images
  images="$(find "$undisturbed/blobs" -name '*.exr' | wc -l)"
  detail="$(grep -cE -- "$signed" emulator.log)"
  [[ "$detail" -ge "$images" ]]
}

# What the server makes of signed URLs that are misused.
misuse() {
  BRDFARM_TEST_BUCKET="$url/misuse" BRDFARM_TEST_REFUSES="$refuses" \
    "$FARM_FAULTS" a_signed_url_takes --ignored --nocapture
  detail="refuses ${refuses:-nothing}"
}

verify() {
  "$BRDFARM" dataset verify --store farm --rerender 10% | tee verify.txt
  detail="$(grep -oE 'verified [0-9]+ images' verify.txt)"
}

# Uploads that nobody completed: an export into the staging of the set is some.
gc() {
  "$BRDFARM" dataset gc --store farm | tee gc-before.txt
  says gc-before.txt "would remove 0 images"
  "$BRDFARM" dataset export "$url/a/set/staging/0123" --store farm --layout files
  "$BRDFARM" dataset gc --store farm >gc-found.txt
  detail="$(tail -1 gc-found.txt | grep -oE '[0-9]+ images')"
  "$BRDFARM" dataset gc --store farm --delete | tail -1 | tee gc-removed.txt
  says gc-removed.txt "removed $detail"
  "$BRDFARM" dataset gc --store farm | tee gc-after.txt
  says gc-after.txt "would remove 0 images"
  equals_undisturbed farm
}

# Options of exports that have a shard of more than one part of a multipart upload, which is 8 MiB.
export_options=(--layout webdataset --npy --rectified 80 --shard-megabytes 64)

export_to_folder() {
  "$BRDFARM" dataset export exported --store farm "${export_options[@]}"
  "$BRDFARM" dataset export local --store "$undisturbed" "${export_options[@]}"
  diff -r exported local
  [[ -n "$(find exported -size +8M)" ]]
  detail="$(du -sm exported | cut -f1) MB"
}

export_to_bucket() {
  "$BRDFARM" dataset export "$url/exports/shards" --store farm "${export_options[@]}"
  # Again: what is there is recognised.
  "$BRDFARM" dataset export "$url/exports/shards" --store farm "${export_options[@]}"
}

import_from_bucket() {
  "$BRDFARM" dataset import "$url/exports/shards" --store imported
  equals_undisturbed imported
  "$BRDFARM" dataset import "$url/exports/shards" --store imported-bucket --blobs "$url/imported"
  equals_undisturbed imported-bucket
}

migrate_away() {
  "$BRDFARM" store migrate farm away
  equals_undisturbed away
  [[ "$(find away/blobs -name '*.exr' | wc -l)" -gt 0 ]]
}

migrate_back() {
  "$BRDFARM" store migrate away back --blobs "$url/back"
  equals_undisturbed back
  [[ ! -d back/blobs ]] || [[ -z "$(find back/blobs -name '*.exr')" ]]
}

do_step start
for name in farm signed misuse verify gc export_to_folder export_to_bucket import_from_bucket \
  migrate_away migrate_back; do
  do_step "$name"
done
