// SPDX-License-Identifier: Apache-2.0
// Loops that are compiled a second time for processors with wider registers, one of which is chosen when they are loaded. The
// results are the same: nothing is contracted, no sum takes another order.
#pragma once

#include <cstdlib>  // tells whether this is the C library that can choose

#if defined(__GLIBC__) && defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define GRASPTRACK_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define GRASPTRACK_WIDE
#endif
