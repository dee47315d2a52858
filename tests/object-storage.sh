#!/usr/bin/env bash
# What images in a bucket cost, with a real S3 server (s3s-fs) on this machine: how fast a farm's
# workers upload beside a plain client, then memory and requests an image of verify, gc and export
# over 126,000 small objects, in some 20 minutes: BRDFARM_SCALE_MATERIALS=1000 makes it smaller, and
# BRDFARM_SCALE_PROFILE=dev spares the release build.
set -euo pipefail
cd "$(dirname "$0")/.."

profile="${BRDFARM_SCALE_PROFILE:-release}"
for test in uploads_keep_up_with_a_plain_client a_large_bucket_takes_bounded_memory; do
  cargo test --quiet --profile "$profile" --test farm_faults "$test" -- --ignored --nocapture
done
