#!/usr/bin/env bash
# Measure gatjax on a machine with an NVIDIA GPU: bench of every backend at the paper's
# size, and one generation of the paper's search. JSON, CSV and log go to $OUT (else: out).
#
# Where pip can install gatjax[cuda,warp], do that and call this. On a machine without a
# network, gpu_pack.sh makes .whl/0, .whl/1, ...: call this once with each; the parts add
# up in /tmp as long as the machine is kept, and the call with the last one measures.
#
#   WORLDS, SECONDS_EACH, POPULATION, ROLLOUTS   smaller, to try the script on a CPU
#   KINDS, MODELS   of gatjax bench: each pair is compiled by itself
#   BACKENDS   "native" on a machine without a GPU; one at a time where a call may not last
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

out=${OUT:-out}
parts=${PARTS:-/tmp/gatjax-parts}
site=${SITE:-/tmp/gatjax-site}
mkdir -p "$out"

if compgen -G '.whl/*/count' >/dev/null; then
    mkdir -p "$parts"
    cp .whl/*/part.* "$parts/"
    count=$(sort -u .whl/*/count)
    found=$(find "$parts" -name 'part.*' | wc -l)
    if [ "$found" -lt "$count" ]; then
        echo "$found of $count parts are here; call again with the next"
        exit 0
    fi
    if [ ! -d "$site" ]; then
        cat "$parts"/part.* | python3 -c 'import sys, tarfile
tarfile.open(fileobj=sys.stdin.buffer, mode="r|xz").extractall(sys.argv[1], filter="tar")
' "$site.new"
        mv "$site.new" "$site"
    fi
    export PYTHONPATH="$site:$PWD${PYTHONPATH:+:$PYTHONPATH}"
fi

gatjax() {
    python3 -c 'import sys; from gatjax.cli import main; sys.exit(main())' "$@"
}

# JAX takes three quarters of the GPU's memory at once unless told not to; the peak that
# bench prints is then what was needed.
export PYTHONUNBUFFERED=1 XLA_PYTHON_CLIENT_PREALLOCATE=false XDG_CACHE_HOME=/tmp/cache
size=(--worlds "${WORLDS:-3000}" --seconds "${SECONDS_EACH:-7.5}")
paper=(--population "${POPULATION:-150}" --rollouts "${ROLLOUTS:-20}" --generations 1)
failed=0

exec > >(tee "$out/log.txt") 2>&1
nvidia-smi || echo "no NVIDIA GPU here"
gatjax doctor || failed=1

# One process a backend: its peak memory is its own, and one that breaks stops no other.
for backend in ${BACKENDS:-mjx-jax mjx-warp native environment}; do
    echo "== bench $backend"
    gatjax bench "${size[@]}" --backends "$backend" --kinds ${KINDS:-grounded} \
        --models ${MODELS:-full light} --json "$out/bench-$backend.json" || failed=1
    [ "$backend" = environment ] && continue  # a loop to compare with: it searches nothing
    echo "== one generation of the paper on $backend"
    kind=(--backend "${backend%%-*}")
    [ "$backend" = native ] || kind+=(--impl "${backend#*-}")
    search=$(mktemp -d)
    if time gatjax search "${paper[@]}" "${kind[@]}" --out "$search"; then
        cp "$search/metrics.csv" "$out/paper-$backend.csv"
    else
        failed=1
    fi
done
exit "$failed"
