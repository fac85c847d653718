// SPDX-License-Identifier: Apache-2.0
//
// The message with which a function refuses its input or fails.
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "calib/base/error.h"

namespace plenocal::testing {

/// The message of the error of this kind that `run` throws.
template <typename Run>
std::string RefusalOf(const Run& run, ErrorKind kind = ErrorKind::kInput) {
  try {
    run();
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), kind) << error.what();
    return error.what();
  }
  return "no refusal";
}

/// "input: " or "job: " and the message with which `call` refuses; "" if it does not.
template <typename Call>
std::string Refusal(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return (error.kind() == ErrorKind::kInput ? "input: " : "job: ") + std::string(error.what());
  }
  return {};
}

}  // namespace plenocal::testing
