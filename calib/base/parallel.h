// SPDX-License-Identifier: Apache-2.0
//
// Loops over independent items on several threads.
#pragma once

#include <cstddef>
#include <functional>

namespace plenocal {

/// Calls body(i) for i in [0, count) on up to `threads` threads (0: all cores). Each i runs exactly
/// once, in any order, so results must go to places of their own. The first exception is passed on
/// after all threads have ended.
void ParallelFor(size_t count, int threads, const std::function<void(size_t)>& body);

/// The run that a thread works for (`RunScope`, calib/io/input_file.h), which `ParallelFor` hands
/// to its threads; null: none.
inline thread_local void* run_of_thread = nullptr;

/// The number of threads that `threads` = 0 means.
int DefaultThreads();

}  // namespace plenocal
