#!/usr/bin/env bash
# Pack what gatjax needs and a GPU machine without a network lacks, as folders of one part
# each: .whl/0, .whl/1, ... JAX with its CUDA plugins and numpy are to be there already.
# Then carry the folders one call after the other, and run benchmarks/gpu.sh in each call:
# the last one measures.
#
#   benchmarks/gpu_pack.sh           native, mjx-jax
#   benchmarks/gpu_pack.sh warp      and mjx-warp (warp-lang is large)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

packages=(
    absl-py aiofiles contourpy cycler docstring_parser dotmap etils evosax flax fonttools
    fsspec glfw humanize kiwisolver markdown-it-py matplotlib mdurl msgpack mujoco
    mujoco-core mujoco-mjx mujoco-studio optax orbax-checkpoint packaging pillow
    prometheus_client protobuf psutil pyarrow Pygments PyOpenGL pyparsing python-dateutil
    PyYAML rich scipy simplejson six tensorstore treescope trimesh typeguard
    typing_extensions tyro uvloop 
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
# Warp compiles for the CPU with it, and nothing here runs Warp on the CPU.
rm -rf "$work"/site/warp/bin/warp-clang.so "$work"/site/warp/examples
tar -C "$work/site" -c . | xz -T0 -3 | split -b 55M -d -a 1 - "$work/part."
count=$(find "$work" -name 'part.*' | wc -l)
for part in "$work"/part.*; do
    folder=.whl/${part##*.}
    mkdir "$folder"
    mv "$part" "$folder/"
    echo "$count" >"$folder/count"
done
du -sh .whl/*
