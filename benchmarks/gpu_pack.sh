#!/usr/bin/env bash
# Pack what gatjax needs and a GPU machine without a network lacks, as folders of one part
# each: .whl/0, .whl/1, ... There are to be JAX with its CUDA plugins, numpy, scipy,
# matplotlib, flax, optax, orbax-checkpoint, pyarrow, rich and PyYAML already (MORE: names
# of packages to take along besides). Then carry the folders one call after the other, and
# run benchmarks/gpu.sh in each call: the last one measures.
#
#   benchmarks/gpu_pack.sh           native, mjx-jax
#   benchmarks/gpu_pack.sh warp      and mjx-warp (warp-lang is large)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

packages=(
    docstring_parser dotmap evosax glfw mujoco mujoco-core mujoco-mjx trimesh typeguard tyro
    ${MORE:-}
)
[ "${1:-}" = warp ] && packages+=(warp-lang)

platforms=()
for tag in manylinux_2_{35,34,31,28,27,26,24,17,12,5}_x86_64 manylinux{2014,2010,1}_x86_64
do
    platforms+=(--platform "$tag")
done

rm -rf .whl
mkdir -p .whl
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"${PYTHON:-python3}" -m pip install --quiet --no-deps --only-binary=:all: --no-compile \
    --implementation cp --python-version 3.12 "${platforms[@]}" \
    --constraint constraints.txt --target "$work/site" "${packages[@]}"
# Warp compiles for the CPU with it, and nothing here runs Warp on the CPU. The large
# dictionary takes five minutes and saves a quarter: two parts instead of three.
rm -rf "$work"/site/warp/bin/warp-clang.so "$work"/site/warp/{examples,tests}
rm -rf "$work"/site/mujoco/{doc,studio}
tar -C "$work/site" -c . | xz --x86 --lzma2=preset=6,dict=256MiB |
    split -b 50M -d -a 1 - "$work/part."
count=$(find "$work" -name 'part.*' | wc -l)
for part in "$work"/part.*; do
    folder=.whl/${part##*.}
    mkdir "$folder"
    mv "$part" "$folder/"
    echo "$count" >"$folder/count"
done
du -sh .whl/*
