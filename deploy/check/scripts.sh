#!/usr/bin/env bash
# Reads every script below deploy/.
set -euo pipefail
# shellcheck source=verdicts.bash
source "$(dirname "$0")/verdicts.bash"
cd "$deploy"

mapfile -t scripts < <(find . -name '*.sh' -o -name '*.bash' -o -name '*.sbatch' | sort)
broken=0
for script in "${scripts[@]}"; do
  bash -n "$script" || { wrong "$script" 'bash -n'; broken=1; }
done
((broken)) || checked "${#scripts[@]} scripts" 'bash -n'
if command -v shellcheck > /dev/null; then
  judge "${#scripts[@]} scripts" shellcheck shellcheck --severity=warning --external-sources --source-path=SCRIPTDIR "${scripts[@]}"
else
  unchecked "${#scripts[@]} scripts" 'shellcheck is not installed'
fi
exit "$failed"
