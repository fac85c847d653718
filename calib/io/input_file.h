// SPDX-License-Identifier: Apache-2.0
//
// The only opener of input files. Each file that a run has read is an input of it, which none of
// its outputs replaces (output_folder.h).
#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

namespace plenocal {

/// A run: the files that its thread reads while the object lives, and those of `ParallelFor` for
/// it, are its inputs. Within another run it is a part of that.
class RunScope {
 public:
  class Inputs;

  /// `owner`: of whoever began the run, for `Owner`.
  explicit RunScope(void* owner = nullptr);
  ~RunScope();
  RunScope(const RunScope&) = delete;
  RunScope& operator=(const RunScope&) = delete;

  /// The run of this thread; null: none.
  static RunScope* Current();
  /// That of this thread's run; null: it has none.
  static void* Owner();
  Inputs& inputs() { return *inputs_; }

 private:
  std::unique_ptr<Inputs> inputs_;  // null: a part of another run
  void* owner_;
};

/// Largest size of a file, in bytes: no file that people use comes near, and one named by mistake
/// does not fill the memory.
enum class InputLimit : std::size_t {
  kDocument = std::size_t{256} << 20,  ///< YAML, JSON, XML, MAT
  /// An image: its file, an archive's entry, a message, the chunk around it, its pixels. The
  /// largest camera's (151 megapixels) in three colours of 16 bits has 866 MB.
  kImage = std::size_t{960} << 20,
  kTable = std::size_t{2} << 30,  ///< tables, trajectories
};

/// The content of a regular file: folders, devices, pipes and sockets are refused without waiting
/// for them. Throws `Error` of kind kInput, naming the file, when there is none or it cannot be
/// read, and of kind kJob where a killed run left the folder's results half moved
/// (announced_moves.h). Changes nothing on the disk.
std::string ReadInput(const std::filesystem::path& path, InputLimit limit);

/// `ReadInput` of text: refuses content with zero bytes, which no text in ASCII or UTF-8 has.
std::string ReadTextFile(const std::filesystem::path& path, InputLimit limit = InputLimit::kTable);

/// The first `size` bytes of the file, or all of a shorter one: for the headers of many files.
std::string ReadInputStart(const std::filesystem::path& path, std::size_t size);

/// Opens a file as `ReadInput` for a library that reads parts of it: a descriptor that the caller
/// closes.
/// Its size is not limited.
int OpenInput(const std::filesystem::path& path);

/// Like `ReadInput` for a result of an earlier run, which this run may replace.
std::string ReadEarlierResult(const std::filesystem::path& path);

/// Makes a file that was read before this run, if it is there, an input of it.
void UseAsInput(const std::filesystem::path& path);

/// True when there is a file or folder; false where the path cannot be one's, such as a name that
/// is too long.
bool IsThere(const std::filesystem::path& path);

/// The path of this run's input that was read from the file which `path` is too; nothing when
/// `path` is no input.
std::optional<std::filesystem::path> InputAt(const std::filesystem::path& path);

}  // namespace plenocal
