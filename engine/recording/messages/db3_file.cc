// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/db3_file.h"

#include <fmt/format.h>
#include <sqlite3.h>
#include <unistd.h>

#include <algorithm>
#include <limits>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/recording/messages/unpack.h"

namespace plenocal {
namespace {

constexpr std::size_t kAll = std::numeric_limits<std::size_t>::max();
constexpr auto kMostUnpacked = static_cast<std::size_t>(InputLimit::kImage);

struct FinalizeStatement {
  void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
};
using Statement = std::unique_ptr<sqlite3_stmt, FinalizeStatement>;

/// Null when the tables are not those of rosbag2.
Statement Prepare(sqlite3* database, const char* text) {
  sqlite3_stmt* statement = nullptr;
  sqlite3_prepare_v2(database, text, -1, &statement, nullptr);
  return Statement(statement);
}

std::string ColumnText(sqlite3_stmt* statement, int column) {
  const unsigned char* const text = sqlite3_column_text(statement, column);
  const int size = sqlite3_column_bytes(statement, column);
  return text == nullptr ? std::string() : std::string(text, text + size);
}

/// The path as an address, with which SQLite opens a file that it never writes. A journal beside
/// the file holds messages that are not yet in it; without one nothing but the file is looked at.
std::string ReadOnlyAddress(const std::filesystem::path& path) {
  std::string address = "file:";
  for (const unsigned char c : std::filesystem::absolute(path).string()) {
    address += c == '?' || c == '#' || c == '%' ? fmt::format("%{:02X}", c)
                                                : std::string(1, static_cast<char>(c));
  }
  std::filesystem::path journal = path;
  journal += "-wal";
  std::error_code error;
  const bool has_journal = std::filesystem::file_size(journal, error) > 0 && !error;
  return address + (has_journal ? "?mode=ro" : "?mode=ro&immutable=1");
}

}  // namespace

void Db3File::CloseDatabase::operator()(sqlite3* database) const { sqlite3_close(database); }
void Db3File::CloseBlob::operator()(sqlite3_blob* blob) const { sqlite3_blob_close(blob); }

Db3File::Db3File(const std::filesystem::path& path) : path_(path) {
  close(OpenInput(path));  // no output may replace it
  sqlite3* opened = nullptr;
  const int code = sqlite3_open_v2(ReadOnlyAddress(path).c_str(),
                                   &opened,
                                   SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX,
                                   nullptr);
  database_.reset(opened);
  if (code != SQLITE_OK) {
    throw InputError("{}: cannot be opened ({}); copy it again", path.string(), Reason());
  }
  // The file comes from strangers: its schema runs no functions, and its cells are checked.
  sqlite3_db_config(opened, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  // Without this SQLite reads nothing of a file that is shorter than its header states.
  sqlite3_db_config(opened, SQLITE_DBCONFIG_WRITABLE_SCHEMA, 1, nullptr);
  sqlite3_exec(opened, "PRAGMA cell_size_check = ON", nullptr, nullptr, nullptr);
  ReadTopics();
  ReadMessages();
}

Db3File::~Db3File() = default;

std::string Db3File::Reason() const { return sqlite3_errmsg(database_.get()); }

void Db3File::ReadTopics() {
  // Views could stand for tables and never end.
  const Statement tables = Prepare(
      database_.get(),
      "SELECT count(*) FROM sqlite_schema WHERE type = 'table' AND name IN ('topics', 'messages')");
  const bool ready = tables && sqlite3_step(tables.get()) == SQLITE_ROW;
  if (!ready || sqlite3_column_int(tables.get(), 0) != 2) {
    const bool damaged = sqlite3_errcode(database_.get()) == SQLITE_CORRUPT;
    throw InputError("{}: {}",
                     path_.string(),
                     damaged ? "is damaged at its beginning; copy it again"
                             : "is a database, but none of rosbag2: it has no tables "
                               "'topics' and 'messages'");
  }
  const Statement rows =
      Prepare(database_.get(), "SELECT id, name, type, serialization_format FROM topics");
  while (rows && sqlite3_step(rows.get()) == SQLITE_ROW) {
    topic_of_id_.emplace_back(sqlite3_column_int64(rows.get(), 0),
                              TopicIndex(ColumnText(rows.get(), 1),
                                         ColumnText(rows.get(), 2),
                                         CodingOfName(ColumnText(rows.get(), 3))));
  }
}

void Db3File::ReadMessages() {
  const Statement rows =
      Prepare(database_.get(), "SELECT id, topic_id, timestamp FROM messages ORDER BY id");
  int code = rows ? SQLITE_ROW : SQLITE_ERROR;
  std::size_t lost = 0;
  while (rows && (code = sqlite3_step(rows.get())) == SQLITE_ROW) {
    const std::int64_t row = sqlite3_column_int64(rows.get(), 0);
    const std::int64_t id = sqlite3_column_int64(rows.get(), 1);
    const auto topic =
        std::ranges::find(topic_of_id_, id, [](const auto& entry) { return entry.first; });
    if (topic == topic_of_id_.end()) continue;
    ByteVector start;
    if (IsWanted(topic->second)) {
      // The first bytes of a packed message need all of it.
      constexpr std::size_t kPeek = 16;
      std::optional<ByteVector> content = Content(row, kPeek);
      if (content && IsZstd(*content)) {
        content = Content(row, kAll);
      }
      if (!content) {
        ++lost;
        continue;
      }
      start = std::move(*content);
    }
    AddMessage({.topic = topic->second,
                .logged = sqlite3_column_int64(rows.get(), 2),
                .block = static_cast<std::uint64_t>(row)},
               start);
  }
  if (code != SQLITE_DONE) {
    AddDamage(
        fmt::format("is damaged or cut off ({}); the messages after that are lost", Reason()));
  }
  if (lost > 0) AddDamage(fmt::format("{} messages about images are damaged", lost));
}

std::optional<ByteVector> Db3File::Content(std::int64_t row, std::size_t most) const {
  int code = SQLITE_OK;
  if (blob_) {
    code = sqlite3_blob_reopen(blob_.get(), row);
  } else {
    sqlite3_blob* opened = nullptr;
    code = sqlite3_blob_open(database_.get(), "main", "messages", "data", row, 0, &opened);
    blob_.reset(opened);
  }
  if (code != SQLITE_OK) {
    blob_.reset();
    return std::nullopt;
  }
  const auto size = static_cast<std::size_t>(std::max(0, sqlite3_blob_bytes(blob_.get())));
  ByteVector bytes(std::min(size, most));
  if (sqlite3_blob_read(blob_.get(), bytes.data(), static_cast<int>(bytes.size()), 0) !=
      SQLITE_OK) {
    blob_.reset();
    return std::nullopt;
  }
  if (most < size || !IsZstd(bytes)) return bytes;
  return Unpack(Packing::kZstd, bytes, kMostUnpacked);
}

SharedBytes Db3File::Read(const MessageRef& message, size_t most) const {
  const std::lock_guard lock(mutex_);
  const auto row = static_cast<std::int64_t>(message.block);
  std::optional<ByteVector> bytes = Content(row, most);
  if (bytes && bytes->size() == most && IsZstd(*bytes)) bytes = Content(row, kAll);
  if (bytes) return SharedBytes(std::move(*bytes));
  throw InputError("{}: message {} is damaged or larger than {} MB ({}); copy the file again",
                   path_.string(),
                   message.block,
                   kMostUnpacked >> 20,
                   Reason());
}

}  // namespace plenocal
