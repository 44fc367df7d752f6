#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# Measures what docs/solvers.md says: runs the comparisons of experiments/solvers and rewrites the tables of that file.
# A quarter of an hour on two cores; nothing else should run. VARIFORM: the program (default: of the release build).
# QUICK=1: the sizes of the shipped configs, once, for a look.
set -euo pipefail
cd "$(dirname "$0")/.."

program="${VARIFORM:-build/release/bin/variform}"
runs="runs/solvers"
document="docs/solvers.md"
[ -x "$program" ] || { echo "solvers.sh: no program '$program': build it by scripts/demo.sh, or set VARIFORM" >&2; exit 2; }

compare() {  # NAME [OPTIONS]
  local name="$1"
  shift
  echo "$name" >&2
  "$program" compare "experiments/solvers/$name.toml" --out "$runs/$name" --quiet --resume "$@" 2>"$runs/$name.log" ||
    { cat "$runs/$name.log" >&2; exit 4; }
}
pivot() {  # NAME ROWS VALUE
  "$program" table "$runs/$1" --rows "$2" --columns backend --value "$3"
}

# Replaces what stands between <!-- begin NAME --> and <!-- end NAME --> by standard input.
insert() {  # NAME
  grep -q "<!-- begin $1 -->" "$document" || { echo "solvers.sh: $document has no place '$1'" >&2; exit 2; }
  # By the environment: awk takes backslashes in -v for escapes.
  name=$1 table=$(cat) awk '
    $0 == "<!-- end " ENVIRON["name"] " -->" { inside = 0 }
    !inside { print }
    $0 == "<!-- begin " ENVIRON["name"] " -->" { inside = 1; print ""; print ENVIRON["table"]; print "" }
  ' "$document" >"$document.new"
  mv "$document.new" "$document"
}

mkdir -p "$runs"
often=(--repeats 3 --warm-up 1)
once=(--repeats 1 --warm-up 0 --time-limit 100)
plane='sweep={ "domain.h" = [0.01, 0.005773502691896258, 0.0031622776601683794, 0.0018257418583505536, 0.001] }'
cube='sweep={ "domain.h" = [0.05, 0.03333333333333333, 0.025, 0.02, 0.016666666666666666] }'
if [ "${QUICK:-0}" = 1 ]; then
  often=(--repeats 1 --warm-up 0)
  compare compare-poisson
  compare compare-poisson-volume
else
  compare compare-poisson "${once[@]}" --set "$plane"
  compare compare-poisson-volume "${once[@]}" --set "$cube"
fi
for name in compare-arap-planar compare-arap-surface compare-arap-compressed compare-arap-volume compare-parametrization; do
  compare "$name" "${often[@]}"
done

"$program" doctor | grep -E "^(variform|BLAS)" | sed 's/^/    /' | insert machine
for place in plane:compare-poisson volume:compare-poisson-volume; do
  for value in linear_iterations seconds_total peak_memory; do
    pivot "${place#*:}" domain.h "$value" | insert "poisson ${place%:*} $value"
  done
done
for value in solved iterations seconds_total; do
  pivot compare-arap-planar norm.beta,constraint[1].move.rotate "$value" | insert "planar $value"
  pivot compare-arap-volume "constraint[1].move.rotate" "$value" | insert "volume $value"
  pivot compare-arap-surface "constraint[0].move.scale" "$value" | insert "surface $value"
  pivot compare-parametrization domain.h "$value" | insert "parametrization $value"
done
pivot compare-arap-compressed "constraint[1].move" excess | insert "compressed excess"
cp "$runs/compare-arap-planar/figures/profile.png" docs/solvers-profile.png
cp "$runs/compare-arap-planar/figures/energy-time-6.png" docs/solvers-energy.png
echo "$document is rewritten; figures and reports are in $runs" >&2
