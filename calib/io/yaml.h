// SPDX-License-Identifier: Apache-2.0
//
// The strict reader of the project's YAML files.
#pragma once

#include <cstddef>
#include <filesystem>
#include <initializer_list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace plenocal {

/// Strict reader of the project's YAML files; the only place that knows yaml-cpp.
///
/// Every failure throws `Error` of kind `kInput` whose message starts with
/// "file:line:column: key.path: " and states what was expected, what was found and what to write
/// instead. Stricter than yaml-cpp: equal keys in one map, unknown keys (`CheckKeys`), trailing
/// text after a number ("0.088x"; a length may have its unit) and NaN or infinite numbers are
/// refused. So are anchors and aliases, which nobody needs here, and a second document in the file.
class YamlNode {
 public:
  /// Reads a whole file. Throws for a missing, unreadable, empty or malformed file.
  static YamlNode ReadFile(const std::filesystem::path& path);
  /// Reads from text; `name` stands for the file in messages.
  static YamlNode Parse(const std::string& text, const std::string& name);

  [[nodiscard]] bool IsMap() const;
  [[nodiscard]] bool IsSequence() const;
  [[nodiscard]] bool IsScalar() const;
  [[nodiscard]] bool IsQuoted() const;  ///< a scalar in quotes: text, whatever it looks like
  [[nodiscard]] bool Has(std::string_view key) const;
  /// The value of `key`; throws when this is no map or the key is missing.
  [[nodiscard]] YamlNode At(std::string_view key) const;
  /// The value of `key`; nothing where this is no map or has no such key.
  [[nodiscard]] std::optional<YamlNode> Find(std::string_view key) const;
  /// The elements of a sequence; throws when this is none.
  [[nodiscard]] std::vector<YamlNode> Elements() const;
  /// The entries of a map in the order of the file; throws when this is none.
  [[nodiscard]] std::vector<std::pair<std::string, YamlNode>> Entries() const;

  [[nodiscard]] std::string AsString() const;
  [[nodiscard]] double AsNumber() const;    ///< finite
  [[nodiscard]] double AsPositive() const;  ///< finite and > 0
  [[nodiscard]] double AsLength() const;    ///< m, > 0; "0.025" or with a unit, "25 mm"
  [[nodiscard]] int AsInteger() const;
  [[nodiscard]] bool AsBool() const;  ///< true or false (also True, TRUE, as YAML has it)
  /// A sequence of exactly `count` finite numbers (any number of them for `count` = 0).
  [[nodiscard]] std::vector<double> AsNumbers(std::size_t count) const;
  /// A coordinate or another length that may be negative or 0, m, as `AsLength` reads it.
  [[nodiscard]] double AsSignedLength() const;
  /// A sequence of exactly `count` of these.
  [[nodiscard]] std::vector<double> AsSignedLengths(std::size_t count) const;

  /// Throws, naming the nearest known key, when this map has a key that is not in `known`.
  void CheckKeys(std::initializer_list<std::string_view> known) const;
  void CheckKeys(std::span<const std::string_view> known) const;
  /// Throws, naming all of `keys` that this map lacks. `example` has a line "key: value" for each.
  void RequireKeys(std::span<const std::string_view> keys, std::string_view example) const;
  /// Throws unless the map has `plenocal: 1`.
  void CheckVersion() const;
  /// Throws `Error` at this place: "file:line:column: key.path: message".
  [[noreturn]] void Fail(const std::string& message) const;
  /// Line of the node, counted from 1, for messages about a second place.
  [[nodiscard]] int Line() const;

  /// The file's text from this node on as canonical YAML (used to carry keys into a result file),
  /// ending in a newline. Of a map the keys in `without` are left out.
  [[nodiscard]] std::string Dump(std::initializer_list<std::string_view> without = {}) const;

 private:
  struct Impl;
  explicit YamlNode(std::shared_ptr<const Impl> impl) : impl_(std::move(impl)) {}
  std::shared_ptr<const Impl> impl_;
};

}  // namespace plenocal
