// SPDX-License-Identifier: Apache-2.0
//
// Whole commands, in this process, on small sessions that the input changes: what is behind the
// readers.
#pragma once

#include <vector>

#include "tests/fuzz/readers.h"

namespace plenocal::fuzz {

/// As readers of a file of choices (mutate.h): an empty file is a command with its session as
/// simulated.
std::vector<Reader> Commands();

}  // namespace plenocal::fuzz
