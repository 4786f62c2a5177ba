// SPDX-License-Identifier: Apache-2.0
#pragma once

// Loops that are compiled a second time for processors with wider registers, one of which is chosen when they are loaded. The
// results are the same: nothing is contracted, no sum takes another order.
#if defined(__GLIBC__) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define GRASPTRACK_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define GRASPTRACK_WIDE
#endif
// What such loops call: compiled with them, and as wide.
#if defined(__GNUC__)
#define GRASPTRACK_WITHIN inline __attribute__((always_inline))
#else
#define GRASPTRACK_WITHIN inline
#endif
