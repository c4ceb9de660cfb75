#!/bin/sh
# Build the kernels for arm64 (NEON) and with clang, and compare them with what x86-64 found: tests/native/cross.sh.
# Wants g++-aarch64-linux-gnu, qemu-user and clang; leaves out what is not there.
set -eu
cd "$(dirname "$0")/../.."
check() { # NAME RUNNER CMAKE-OPTIONS...
  name=$1 runner=$2; shift 2
  cmake -S . -B "build/check-$name" -DGOC_KERNEL_CHECK=ON "$@" > /dev/null
  cmake --build "build/check-$name" --parallel > /dev/null
  echo "$name: $($runner "build/check-$name/kernel_check" tests/native/expected.txt)"
}
check native env
command -v clang++ > /dev/null && check clang env -DCMAKE_CXX_COMPILER=clang++
command -v aarch64-linux-gnu-g++ > /dev/null && command -v qemu-aarch64 > /dev/null &&
  check arm64 "qemu-aarch64 -L /usr/aarch64-linux-gnu" -DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64 \
    -DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++
exit 0
