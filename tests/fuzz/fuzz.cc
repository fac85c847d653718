// SPDX-License-Identifier: Apache-2.0
//
// The program of bench/fuzz: libFuzzer on the reader that the environment variable
// PLENOCAL_READER names. Without it: the names of all readers, and of all commands after "command".
#include <fmt/format.h>

#include <cstdint>
#include <cstdlib>

#include "tests/fuzz/readers.h"

namespace {

const plenocal::fuzz::Reader* reader = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  if (const char* const name = std::getenv("PLENOCAL_READER")) {
    reader = &plenocal::fuzz::FindReader(name);
    return 0;
  }
  for (const auto& each : plenocal::fuzz::Readers()) {
    fmt::print("{}{}\n", each.is_command ? "command " : "", each.name);
  }
  std::exit(0);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  plenocal::fuzz::Read(*reader, {reinterpret_cast<const char*>(data), size});
  return 0;
}
