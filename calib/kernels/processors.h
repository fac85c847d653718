// SPDX-License-Identifier: Apache-2.0
//
// The attribute of functions that are compiled for several processors.
#pragma once

/// Before a function: compiled for processors with AVX2 and for all others, chosen at run time.
/// Without AVX2 loops over pixels or rows take two to five times as long, and the program must run
/// on any x86-64. The level x86-64-v3 is chosen by what the processor can do; a processor's name,
/// such as arch=haswell, only by its name. What such a function calls must be inlined to gain by it
/// (`flatten`).
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__)
#define PLENOCAL_FOR_EACH_PROCESSOR __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define PLENOCAL_FOR_EACH_PROCESSOR
#endif
