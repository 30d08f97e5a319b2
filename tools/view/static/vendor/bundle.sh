#!/usr/bin/env bash
# Makes vendor.js, vendor.css and licences.txt of the folder above from npm, byte by byte the same each time:
#   tools/view/static/vendor/bundle.sh
# It needs npm and the network. npm checks each package against the digest that package-lock.json names.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp "$here/package.json" "$here/package-lock.json" "$here/entry.js" "$work"
cd "$work"
npm ci --silent --no-audit --no-fund
npx esbuild entry.js --bundle --minify --format=esm --target=es2022 --charset=utf8 --legal-comments=none \
  --outfile="$here/../vendor.js"
npx esbuild node_modules/uplot/dist/uPlot.min.css --minify --legal-comments=none --outfile="$here/../vendor.css"
for package in @noble/hashes three uplot; do
  printf '%s %s, in vendor.js\n\n' "$package" "$(node -p "require('./node_modules/$package/package.json').version")"
  cat "node_modules/$package/LICENSE"
  printf '\n\n'
done > "$here/licences.txt"
