#!/usr/bin/env bash
# A farm with its images in a bucket of each provider that can be had on one machine: one
# coordinator and two workers render 20 materials, send them by signed URL, and the set is verified,
# collected, exported into a folder and into the bucket, imported out of it, and migrated away and
# back. After each step its labels and images have to equal those of an undisturbed local run. Ends
# with a table of what each provider did.
#
#   tests/buckets.sh [azure|gcs|moto|s3s ...]    all four where none is named
#
#   azure   Azurite (npm)
#   gcs     gcp-storage-emulator (PyPI), behind tests/buckets/gcs_xml.py
#   moto    moto's server (PyPI): S3
#   s3s     s3s-fs (crates.io): S3, with signatures checked
#
# Installs what is missing below target/buckets. BRDFARM=PATH takes a program that is built.
set -euo pipefail
cd "$(dirname "$0")/.."

providers=("$@")
((${#providers[@]})) || providers=(azure gcs moto s3s)
for provider in "${providers[@]}"; do
  tests/buckets/install.sh "$provider"
done
# The tests that try signed URLs, and the program, which is built with them.
FARM_FAULTS="$(cargo test --quiet --test farm_faults --no-run --message-format json \
  | sed -n 's/.*"executable":"\([^"]*farm_faults[^"]*\)".*/\1/p' | tail -1)"
BRDFARM="${BRDFARM:-$PWD/target/debug/brdfarm}"
export BRDFARM FARM_FAULTS

root="$PWD"
work="$(mktemp -d)"
cat >"$work/spec.toml" <<'TOML'
name = "buckets"
materials = 20
[image]
width = 16
height = 16
TOML
"$BRDFARM" run --spec "$work/spec.toml" --store "$work/undisturbed" >"$work/undisturbed.log" 2>&1
"$BRDFARM" dataset manifest export --store "$work/undisturbed" --format parquet \
  --out "$work/undisturbed.parquet"

status=0
for provider in "${providers[@]}"; do
  mkdir "$work/$provider"
  began=$SECONDS
  (cd "$work/$provider" \
    && "$root/tests/buckets/try.sh" "$provider" "$work/undisturbed" "$work/$provider.tsv") || status=1
  echo "$provider: $((SECONDS - began)) s"
done

echo
printf '%-9s %-20s %-8s %s\n' provider step outcome detail
for provider in "${providers[@]}"; do
  while IFS=$'\t' read -r step outcome detail; do
    printf '%-9s %-20s %-8s %s\n' "$provider" "$step" "$outcome" "$detail"
  done <"$work/$provider.tsv"
done
# What failed stays to be looked at.
((status)) || rm -rf "$work"
exit "$status"
