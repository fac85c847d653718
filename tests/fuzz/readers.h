// SPDX-License-Identifier: Apache-2.0
//
// Every reader of files (and of the command line) as one function, for libFuzzer (bench/fuzz) and
// for the tests that read the corpus.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace plenocal::fuzz {

struct Reader {
  std::string name;  ///< also of its folder in the corpus
  std::string file;  ///< name of the file that it is given
  /// Reads the file. Throws `Error` for a file that it refuses, which is right, and
  /// `std::logic_error` for a result that is none: a number that is not finite, or a file written
  /// from the result that our own reader refuses.
  std::function<void(const std::filesystem::path&)> read;
  bool names_file = true;   ///< false: what it reads is no file for the user
  bool is_command = false;  ///< a whole command (commands.h), which takes some 50 ms
};

/// All readers, then the commands. Formats of other tools are in it without an edit here.
const std::vector<Reader>& Readers();

/// The bytes of a file.
std::string ContentOf(const std::filesystem::path& path);

/// The reader of that name. Throws `std::logic_error` with all names when there is none.
const Reader& FindReader(std::string_view name);

/// Gives `input` to the reader as a file in a folder of its own in memory; false when it is
/// refused. Throws `std::logic_error` as `Reader::read`, and for a refusal that does not name the
/// file. Any other exception is the reader's.
bool Read(const Reader& reader, std::string_view input);

}  // namespace plenocal::fuzz
