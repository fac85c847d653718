// SPDX-License-Identifier: Apache-2.0
//
// The exceptions of the library, and the nearest known name for messages.
#pragma once

#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

namespace plenocal {

/// The cause of a failure, which gives the exit status of the command (docs/formats.md).
enum class ErrorKind {
  kInput,  ///< the command line or an input file is wrong: exit status 2
  kJob,    ///< the inputs are readable, but the job cannot be done with them: exit status 1
  kGrade,  ///< the results are written, but worse than the user requires: exit status 3
};

/// The one exception of the library. `what()` is a single line for the user: where it happened
/// ("target.yaml:3:9: size: "), what was expected and found, and what to do about it.
class Error : public std::runtime_error {
 public:
  Error(ErrorKind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  [[nodiscard]] ErrorKind kind() const { return kind_; }

 private:
  ErrorKind kind_;
};

/// Thrown by long work whose progress callback asked it to stop.
struct Stopped {};

/// The name in `known` that is nearest to `name` by edit distance; empty when none is near enough
/// to be meant (more than half of the letters differ).
std::string_view NearestName(std::string_view name, std::span<const std::string_view> known);

/// "; did you mean 'chessboard'?" when a near name exists, otherwise "; known: a, b, c".
std::string SuggestName(std::string_view name, std::span<const std::string_view> known);

}  // namespace plenocal
