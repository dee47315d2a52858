#!/usr/bin/env bash
# Builds the documentation site into target/site, and checks every link and anchor in it. Installs
# mdBook and LinkChecker below target/ and nowhere else; that takes some minutes the first time.
# Fails if a link is broken.
#
#   docs/build.sh               links within the site
#   docs/build.sh --external    links to other sites too, which need a network
set -euo pipefail
cd "$(dirname "$0")/.."

mdbook_version='0.5.4'
tools='target/docs-tools'
checker="$tools/linkchecker"
site='target/site'
requirements='docs/tools/requirements.txt'

external=()
case "${1:-}" in
  '') ;;
  --external) external=(--check-extern) ;;
  *) sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
esac

say() { printf 'docs: %s\n' "$*"; }

if [[ "$("$tools/bin/mdbook" --version 2>/dev/null || true)" != "mdbook v$mdbook_version" ]]; then
  say "installing mdBook $mdbook_version"
  cargo install --quiet --locked --root "$tools" --version "$mdbook_version" \
    --no-default-features --features search mdbook
fi

wanted="$(sha256sum "$requirements" | cut -d' ' -f1)"
if [[ "$(cat "$checker/requirements.sha256" 2>/dev/null || true)" != "$wanted" ]]; then
  say 'installing LinkChecker'
  rm -rf "$checker"
  python3 -m venv "$checker"
  "$checker/bin/pip" --disable-pip-version-check --quiet install --require-hashes \
    --requirement "$requirements"
  echo "$wanted" >"$checker/requirements.sha256"
fi

rm -rf "$site"
"$tools/bin/mdbook" build docs
# mdBook copies every file of docs/ that is no page. These are no part of the site.
rm -rf "$site/book.toml" "$site/build.sh" "$site/tools"

say 'checking links'
# A file of its own, so that a configuration of the user changes nothing.
"$checker/bin/linkchecker" --config docs/tools/linkchecker.ini --no-status "${external[@]}" "$site/index.html"
say "open $site/index.html"
