// SPDX-License-Identifier: Apache-2.0
//
// Files of messages, written here by the rules of their formats, whole and damaged.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sqlite3.h>
#include <zlib.h>

#include <algorithm>
#include <functional>

#include "engine/recording/messages/bag_file.h"
#include "engine/recording/messages/db3_file.h"
#include "engine/recording/messages/mcap_file.h"
#include "tests/engine/recording/message_bytes.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Form = MessageWriter::Form;
constexpr std::int64_t kSecond = 1'000'000'000;
const std::string kBagStart(kBagMagic), kMcapStart(kMcapMagic);

std::string BagImage(int i) {
  return ImageMessage(Form::kRos1, 100 + i, 10 * i, static_cast<char>('a' + i));
}
std::string CdrImage(int i) {
  return ImageMessage(Form::kCdr, 100 + i, 10 * i, static_cast<char>('a' + i));
}
/// True for sizes of a file about each end of a record, and for some between.
bool IsTried(size_t size, const std::vector<size_t>& ends) {
  constexpr size_t kStep = 101;
  return size % kStep == 0 ||
         std::ranges::any_of(ends, [&](size_t end) { return size + 2 >= end && size <= end + 10; });
}

/// Message `i` of a bag is logged 1 s and i ns after its stamp.
std::string LoggedImage(int i, int connection = 3) {
  return BagMessage(connection, 101 + i, 11 * i, BagImage(i));
}
std::string McapImage(int i, int channel = 3) {
  return McapMessage(
      static_cast<std::uint16_t>(channel), (101 + i) * kSecond + 11 * i, CdrImage(i));
}

class MessageFiles : public InTemporaryFolder {
 protected:
  [[nodiscard]] std::shared_ptr<const MessageFile> Open(const std::string& content,
                                                        const std::string& name = "file") const {
    return OpenMessageFile(Write(name, content));
  }

  /// Expects the messages `numbers` of the topic, with times and contents.
  static void ExpectImages(const MessageFile& file,
                           const std::vector<int>& numbers,
                           const std::function<std::string(int)>& image) {
    ASSERT_EQ(file.Messages().size(), numbers.size());
    for (size_t k = 0; k < numbers.size(); ++k) {
      const MessageRef& ref = file.Messages()[k];
      const int i = numbers[k];
      EXPECT_EQ(file.Topics()[ref.topic].name, "/left/image_raw");
      EXPECT_EQ(ref.logged, (101 + i) * kSecond + 11 * i);
      EXPECT_EQ(ref.stamp, (100 + i) * kSecond + 10 * i);
      EXPECT_EQ(TextOfBytes(file.Read(ref, 1'000'000).bytes), image(i));
      EXPECT_EQ(TextOfBytes(file.Read(ref, 21).bytes), image(i).substr(0, 21));
    }
  }
  [[nodiscard]] std::vector<std::string> DamageOf(const std::string& content) const {
    return Open(content)->Damage();
  }
};

const std::string kBagTopics = BagConnection(3, "/left/image_raw", "sensor_msgs/Image") +
                               BagConnection(5, "/imu", "sensor_msgs/Imu");
const std::string kMcapTopics =
    McapSchema(7, "sensor_msgs/msg/Image") + McapSchema(8, "sensor_msgs/msg/Imu") +
    McapChannel(3, 7, "/left/image_raw", "cdr") + McapChannel(5, 8, "/imu", "cdr");

// ---- bags

TEST_F(MessageFiles, OfRos1HaveMessagesInChunksAndOutside) {
  const std::string three = LoggedImage(3) + BagMessage(5, 1, 1, "imu") + LoggedImage(4);
  const std::string four = LoggedImage(5), five = LoggedImage(6);
  const auto file = Open(kBagStart + BagRecord(BagOperation(3), "index") + kBagTopics +
                         LoggedImage(0) + BagMessage(5, 1, 2, "imu") + LoggedImage(1) +
                         BagChunk("none", LoggedImage(2), LoggedImage(2).size()) +
                         BagChunk("lz4", Lz4(three), three.size()) +
                         BagRecord(BagOperation(4), "") + BagChunk("bz2", Bz2(four), four.size()) +
                         BagChunk("bz2", Bz2(five), five.size()) + LoggedImage(7));
  EXPECT_THAT(file->Damage(), IsEmpty());
  ASSERT_EQ(file->Topics().size(), 2U);
  EXPECT_EQ(file->Topics()[0].name, "/left/image_raw");
  EXPECT_EQ(file->Topics()[0].type, "sensor_msgs/Image");
  EXPECT_EQ(file->Topics()[0].kind, MessageKind::kImage);
  EXPECT_EQ(file->Topics()[0].coding, MessageCoding::kRos1);
  EXPECT_EQ(file->Topics()[0].count, 8U);
  EXPECT_EQ(file->Topics()[1].kind, MessageKind::kOther);
  EXPECT_EQ(file->Topics()[1].count, 2U);
  ExpectImages(*file, {0, 1, 2, 3, 4, 5, 6, 7}, BagImage);
}

TEST_F(MessageFiles, OfRos1AreReadUpToWhereTheyAreCutOff) {
  const std::vector<std::string> records{
      BagConnection(3, "/left/image_raw", "sensor_msgs/Image"), LoggedImage(0), LoggedImage(1)};
  const std::string whole = kBagStart + records[0] + records[1] + records[2];
  size_t complete = 0, start = kBagMagic.size();  // of the records before the end
  const size_t first = start + records[0].size();
  const std::vector<size_t> ends{first, first + records[1].size(), whole.size()};
  for (size_t size = first; size <= whole.size(); ++size) {
    if (!IsTried(size, ends)) continue;
    while (complete < records.size() && start + records[complete].size() <= size) {
      start += records[complete++].size();
    }
    const auto file = Open(whole.substr(0, size));
    ASSERT_EQ(file->Messages().size(), complete - 1) << size;
    if (start == size) {
      EXPECT_THAT(file->Damage(), IsEmpty());
    } else {
      EXPECT_THAT(file->Damage(),
                  ElementsAre(fmt::format("is cut off or damaged at byte {} of {}; what was after "
                                          "that is lost",
                                          start,
                                          size)));
    }
  }
}

TEST_F(MessageFiles, OfRos1HaveWhatIsThereOfTheirLastChunk) {
  const std::string inside = LoggedImage(0) + LoggedImage(1);
  for (const std::string packing : {"none", "lz4"}) {
    const std::string packed = packing == "none" ? inside : Lz4(inside);
    std::string whole = kBagStart + kBagTopics;
    const size_t chunk = whole.size();
    whole += BagChunk(packing, packed, inside.size());
    const size_t cut = packing == "none" ? 1 : 4;  // of lz4 the mark of the end
    const std::string content = whole.substr(0, whole.size() - cut);
    const auto file = Open(content);
    const std::string lost =
        fmt::format("is cut off or damaged at byte {} of {}; what was after that is lost",
                    chunk,
                    content.size());
    if (packing == "none") {
      ExpectImages(*file, {0}, BagImage);
      EXPECT_THAT(file->Damage(),
                  ElementsAre("a chunk is damaged; its later messages are lost", lost));
    } else {
      ASSERT_EQ(file->Messages().size(), 2U);
      EXPECT_THAT(file->Damage(), ElementsAre(lost));
    }
  }
}

TEST_F(MessageFiles, OfRos1LoseChunksThatCannotBeUnpacked) {
  const std::string inside = LoggedImage(0), topics = kBagStart + kBagTopics;
  const std::string last = LoggedImage(7);
  const std::string field = BagField("compression", "lz4");
  const auto damage = [&](const std::string& chunk) {
    const auto file = Open(topics + chunk + last);
    EXPECT_EQ(file->Messages().size(), 1U);
    EXPECT_EQ(file->Damage().size(), 1U);
    return file->Damage()[0];
  };
  const auto place = [&](const std::string& chunk, const std::string& packed) {
    return topics.size() + chunk.size() - packed.size();
  };
  const std::string unknown = BagChunk("abcdefghijklmnopqrst", inside, inside.size());
  EXPECT_EQ(damage(unknown),
            fmt::format("the chunk at byte {} is packed by 'abcdefghijklmnop', which cannot be "
                        "unpacked; its messages are lost",
                        place(unknown, inside)));
  for (const std::string& size : {std::string(), BagField("size", "123")}) {
    EXPECT_THAT(damage(BagRecord(BagOperation(5) + field + size, inside)),
                HasSubstr("is packed by 'lz4', which cannot be unpacked"));
  }
  for (const int wrong : {-1, 1}) {
    const std::string chunk = BagChunk("lz4", Lz4(inside), inside.size() + wrong);
    EXPECT_EQ(damage(chunk),
              fmt::format("the chunk at byte {} is damaged; its messages are lost",
                          place(chunk, Lz4(inside))));
  }
  const std::string garbage = BagChunk("bz2", "no bz2", 10);
  EXPECT_THAT(damage(garbage), HasSubstr("is damaged; its messages are lost"));
}

TEST_F(MessageFiles, OfRos1LeaveOutWhatTheyCannotPlace) {
  const std::string time = BagField("time", U32(1) + U32(2)), image = BagImage(0);
  const auto record = [&](const std::string& fields) {
    return BagRecord(BagOperation(2) + fields, image);
  };
  const std::string conn = BagField("conn", U32(3));
  const std::string nested = BagChunk("none", LoggedImage(1), LoggedImage(1).size());
  const auto file = Open(
      kBagStart + kBagTopics + LoggedImage(2, 4)  // no such connection
      + record(time) + record(conn) + record(BagField("conn", "12") + time) +
      record(conn + BagField("time", U32(1))) + BagRecord(BagField("op", "\x02\x02"), image) +
      BagRecord(conn + time, image) + BagRecord(BagOperation(7) + BagField("topic", "/x"), "") +
      BagChunk("none", nested, nested.size()) +
      // A header's fields before its damage are taken.
      record(conn + time + U32(100) + "x=y") + record(conn + time + Counted32("none")) +
      record(U32(100) + conn + time) + record(conn + time + "abc"));
  EXPECT_THAT(file->Damage(), IsEmpty());
  EXPECT_EQ(file->Topics().size(), 2U);
  ASSERT_EQ(file->Messages().size(), 3U);
  for (const MessageRef& ref : file->Messages()) EXPECT_EQ(ref.logged, kSecond + 2);
}

TEST_F(MessageFiles, OfRos1HaveHeadersOfAMegabyteAtMost) {
  const std::string fields =
      BagOperation(2) + BagField("conn", U32(3)) + BagField("time", U32(101) + U32(0));
  const auto messages = [&](size_t size) {
    const std::string name = "pad=";
    const std::string pad(size - fields.size() - 4 - name.size(), 'x');
    const std::string header = fields + Counted32(name + pad);
    EXPECT_EQ(header.size(), size);
    return Open(kBagStart + kBagTopics + BagRecord(header, BagImage(0)))->Messages().size();
  };
  constexpr size_t kMost = 1 << 20;
  EXPECT_EQ(messages(kMost), 1U);
  EXPECT_EQ(messages(kMost + 1), 0U);
}

TEST_F(MessageFiles, GiveOneTopicToConnectionsOfOneNameAndType) {
  const auto file =
      Open(kBagStart + kBagTopics + BagConnection(9, "/left/image_raw", "sensor_msgs/Image") +
           BagConnection(10, "/left/image_raw", "sensor_msgs/Imu") +
           BagConnection(11, "/imu", "sensor_msgs/Image") + LoggedImage(0) + LoggedImage(1, 9) +
           LoggedImage(2, 10));
  ASSERT_EQ(file->Topics().size(), 4U);
  EXPECT_EQ(file->Topics()[0].count, 2U);
  EXPECT_EQ(file->Topics()[2].type, "sensor_msgs/Imu");
  EXPECT_EQ(file->Topics()[3].name, "/imu");
  ExpectImages(*file, {0, 1}, BagImage);
}

TEST_F(MessageFiles, WithoutATimeInTheHeaderHaveNoStamp) {
  const auto file = Open(kBagStart + kBagTopics + BagMessage(3, 7, 8, std::string(11, 'x')) +
                         BagMessage(3, 7, 9, std::string(12, '\x01')));
  ASSERT_EQ(file->Messages().size(), 2U);
  EXPECT_EQ(file->Messages()[0].stamp, 0);
  EXPECT_EQ(file->Messages()[0].size, 11U);
  EXPECT_EQ(file->Messages()[1].stamp, 0x01010101 * kSecond + 0x01010101);
}

// ---- MCAP

TEST_F(MessageFiles, OfMcapHaveMessagesInChunksAndOutside) {
  const std::string two = McapImage(2) + McapMessage(5, 1, "imu") + McapImage(3);
  const std::string four = McapImage(4), five = McapImage(5);
  const auto crc = [](const std::string& text) {
    const ByteVector bytes = BytesOf(text);
    return static_cast<std::uint32_t>(crc32_z(0, bytes.data(), bytes.size()));
  };
  const auto file =
      Open(kMcapStart + McapRecord(1, "head") + kMcapTopics + McapImage(0) + McapMessage(5, 1, "") +
           McapRecord(130, "unknown") + McapImage(1) + McapChunk("lz4", Lz4(two), two.size()) +
           // The end of data counts outside of chunks alone.
           McapChunk("", McapDataEnd() + four, (McapDataEnd() + four).size()) +
           McapChunk("zstd", Zstd(five), five.size(), crc(five)) + McapDataEnd() + McapImage(6));
  EXPECT_THAT(file->Damage(), IsEmpty());
  ASSERT_EQ(file->Topics().size(), 2U);
  EXPECT_EQ(file->Topics()[0].type, "sensor_msgs/msg/Image");
  EXPECT_EQ(file->Topics()[0].coding, MessageCoding::kCdr);
  EXPECT_EQ(file->Topics()[1].count, 2U);
  ExpectImages(*file, {0, 1, 2, 3, 4, 5}, CdrImage);
}

TEST_F(MessageFiles, OfMcapAreReadUpToWhereTheyAreCutOff) {
  const std::vector<std::string> records{McapImage(0), McapImage(1), McapDataEnd()};
  const std::string head = kMcapStart + kMcapTopics;
  const std::string whole = head + records[0] + records[1] + records[2];
  size_t complete = 0, start = head.size();
  const std::vector<size_t> ends{
      start, start + records[0].size(), whole.size() - records[2].size(), whole.size()};
  for (size_t size = start; size <= whole.size(); ++size) {
    if (!IsTried(size, ends)) continue;
    while (complete < records.size() && start + records[complete].size() <= size) {
      start += records[complete++].size();
    }
    const auto file = Open(whole.substr(0, size));
    ASSERT_EQ(file->Messages().size(), std::min<size_t>(complete, 2)) << size;
    if (complete == records.size()) {
      EXPECT_THAT(file->Damage(), IsEmpty());
    } else {
      EXPECT_THAT(
          file->Damage(),
          ElementsAre(fmt::format("{} at byte {} of {}; what was after that is lost",
                                  start == size ? "ends without an end of data" : "is cut off",
                                  start,
                                  size)));
    }
  }
}

TEST_F(MessageFiles, OfMcapEndAtARecordWithoutAKind) {
  const std::string head = kMcapStart + kMcapTopics + McapImage(0);
  const std::string content = head + McapRecord(0, "x") + McapImage(1);
  EXPECT_THAT(DamageOf(content),
              ElementsAre(fmt::format("is damaged at byte {} of {}; what was after that is lost",
                                      head.size(),
                                      content.size())));
  const std::string inside = McapImage(1) + McapRecord(0, "x") + McapImage(2);
  const auto file =
      Open(head + McapChunk("", inside, inside.size()) + McapImage(3) + McapDataEnd());
  ExpectImages(*file, {0, 1, 3}, CdrImage);
  EXPECT_THAT(file->Damage(), ElementsAre("is damaged in a chunk; its later messages are lost"));
}

TEST_F(MessageFiles, OfMcapHaveWhatIsThereOfTheirLastChunk) {
  const std::string inside = McapImage(0) + McapImage(1), head = kMcapStart + kMcapTopics;
  for (const std::string packing : {"", "lz4"}) {
    const std::string packed = packing.empty() ? inside : Lz4(inside);
    const std::string whole = head + McapChunk(packing, packed, inside.size());
    const std::string content = whole.substr(0, whole.size() - (packing.empty() ? 1 : 4));
    const auto file = Open(content);
    const std::string lost = fmt::format(
        "is cut off at byte {} of {}; what was after that is lost", head.size(), content.size());
    if (packing.empty()) {
      ExpectImages(*file, {0}, CdrImage);
      EXPECT_THAT(file->Damage(),
                  ElementsAre("is cut off in a chunk; its later messages are lost", lost));
    } else {
      ExpectImages(*file, {0, 1}, CdrImage);
      EXPECT_THAT(file->Damage(), ElementsAre(lost));
    }
  }
}

TEST_F(MessageFiles, OfMcapLoseChunksThatCannotBeUnpacked) {
  const std::string inside = McapImage(0), head = kMcapStart + kMcapTopics;
  const auto damage = [&](const std::string& chunk) {
    const auto file = Open(head + chunk + McapImage(7) + McapDataEnd());
    ExpectImages(*file, {7}, CdrImage);
    EXPECT_EQ(file->Damage().size(), 1U);
    return file->Damage()[0];
  };
  constexpr size_t kRecordHeader = 9;
  const size_t content = head.size() + kRecordHeader;
  EXPECT_EQ(damage(McapChunk("abcdefghijklmnopqrst", inside, inside.size())),
            fmt::format("the chunk at byte {} is packed by 'abcdefghijklmnop', which cannot be "
                        "unpacked; record with zstd, lz4 or none",
                        content));
  // The chunk states one byte more than its record has.
  std::string longer = McapChunk("", inside, inside.size());
  const size_t size_at = kRecordHeader + 8 + 8 + 8 + 4 + 4;
  longer.replace(size_at, 8, Little(std::uint64_t{inside.size() + 1}));
  const std::string damaged =
      fmt::format("the chunk at byte {} is damaged; its messages are lost", content);
  EXPECT_EQ(damage(longer), damaged);
  EXPECT_EQ(damage(McapRecord(6, std::string(31, '\0'))), damaged);
  const std::string packed = Zstd(inside);
  const auto lost = [&](size_t unpacked, std::uint32_t crc) {
    return damage(McapChunk("zstd", packed, unpacked, crc));
  };
  const std::string at_packed =
      fmt::format("the chunk at byte {} is damaged; its messages are lost",
                  content + 40 + std::string("zstd").size());
  EXPECT_EQ(lost(inside.size() - 1, 0), at_packed);
  EXPECT_EQ(lost(inside.size() + 1, 0), at_packed);
  EXPECT_EQ(lost(inside.size(), 1), at_packed);
}

TEST_F(MessageFiles, OfMcapLeaveOutWhatTheyCannotPlace) {
  const std::string cut_channel = Little(std::uint16_t{4}) + Little(std::uint16_t{7}) + U32(50);
  const auto file =
      Open(kMcapStart + McapRecord(3, Little(std::uint16_t{7}) + U32(99)) + kMcapTopics +
           McapRecord(4, cut_channel) + McapImage(0, 4) + McapRecord(5, std::string(21, '\3')) +
           McapChannel(6, 99, "/none", "ros1") + McapMessage(6, 1, "x") + McapMessage(3, 5, "") +
           McapDataEnd());
  EXPECT_THAT(file->Damage(), IsEmpty());
  ASSERT_EQ(file->Topics().size(), 3U);
  EXPECT_EQ(file->Topics()[2].type, "");
  EXPECT_EQ(file->Topics()[2].coding, MessageCoding::kRos1);
  EXPECT_EQ(file->Topics()[2].count, 1U);
  ASSERT_EQ(file->Messages().size(), 1U);  // of 22 bytes: it is there and holds nothing
  EXPECT_EQ(file->Messages()[0].size, 0U);
  EXPECT_EQ(file->Messages()[0].logged, 5);
}

TEST_F(MessageFiles, OfManyPackedChunksAreReadInAnyOrder) {
  std::string content = kMcapStart + kMcapTopics;
  for (int i = 0; i < 7; ++i) content += McapChunk("zstd", Zstd(McapImage(i)), McapImage(i).size());
  const auto file = Open(content + McapDataEnd());
  ExpectImages(*file, {0, 1, 2, 3, 4, 5, 6}, CdrImage);
  for (const int i : {6, 0, 5, 0, 4, 1, 0, 6, 3}) {
    EXPECT_EQ(TextOfBytes(file->Read(file->Messages()[i], 1000).bytes), CdrImage(i));
  }
  // Those that were read are kept; another one is found to have changed.
  Write("file", content.substr(0, kMcapStart.size()) + std::string(content.size(), 'x'));
  EXPECT_EQ(TextOfBytes(file->Read(file->Messages()[3], 1000).bytes), CdrImage(3));
  EXPECT_EQ(TextOfBytes(file->Read(file->Messages()[1], 1000).bytes), CdrImage(1));
  EXPECT_THAT(RefusalOf([&] { static_cast<void>(file->Read(file->Messages()[2], 1000)); }),
              EndsWith("has changed while it was read"));
}

TEST_F(MessageFiles, RefuseMessagesAndChunksOfMoreThan960MB) {
  const std::uint64_t most = std::uint64_t{960} << 20;
  const auto file = Open(kBagStart + kBagTopics + LoggedImage(0));
  MessageRef ref = file->Messages()[0];
  ref.size = most + (std::uint64_t{1} << 20);
  EXPECT_EQ(RefusalOf([&] { static_cast<void>(file->Read(ref, ref.size)); }),
            fmt::format("{}: the message at byte {} has 961 MB; at most 960 are read",
                        Path("file").string(),
                        ref.offset));
  const std::string head = kMcapStart + kMcapTopics;
  EXPECT_THAT(DamageOf(head + McapChunk("zstd", "x", most + 1) + McapDataEnd()),
              ElementsAre(fmt::format("the chunk at byte {} has 960 MB, of which at most 960 are "
                                      "read; its messages are lost",
                                      head.size() + 9 + 44)));
  EXPECT_THAT(DamageOf(head + McapChunk("zstd", "x", most) + McapDataEnd()),
              ElementsAre(HasSubstr("is damaged; its messages are lost")));
}

TEST_F(MessageFiles, AreKnownByTheirFirstBytes) {
  const auto refusal = [&](const std::string& content) {
    return RefusalOf([&] { static_cast<void>(Open(content)); });
  };
  const std::string file = Path("file").string();
  EXPECT_EQ(refusal(""), file + ": is empty (0 bytes); copy it again");
  EXPECT_EQ(refusal("text"),
            file +
                ": is no MCAP file, bag of ROS 1 or database of ROS 2, or damaged at its "
                "beginning; copy it again");
  EXPECT_EQ(refusal("#ROSBAG V1.2\nmore"),
            file + ": is a bag of an old version, '#ROSBAG V1.2'; convert it by 'rosbag migrate'");
  EXPECT_EQ(refusal(kMcapStart + "\x05"),
            file +
                ": is cut off at byte 8 of 9; what was after that is lost, and holds no message "
                "before; copy it again");
  EXPECT_THAT(Open(kBagStart)->Topics(), IsEmpty());
  for (const char* name : {"a.mcap", "a.MCAP", "b/a.bag", "a.Db3"}) {
    EXPECT_TRUE(IsMessageFileName(name)) << name;
  }
  for (const char* name : {"a.mcap.zip", "mcap", "a.db", ""}) {
    EXPECT_FALSE(IsMessageFileName(name)) << name;
  }
}

// ---- databases

class Databases : public MessageFiles {
 protected:
  using Row = std::tuple<int, int, std::int64_t, std::string>;  // id, topic, time, data

  static void Execute(sqlite3* database, const std::string& text) {
    ASSERT_EQ(sqlite3_exec(database, text.c_str(), nullptr, nullptr, nullptr), SQLITE_OK)
        << sqlite3_errmsg(database);
  }
  static void AddRows(sqlite3* database, const std::vector<Row>& rows) {
    for (const auto& [id, topic, time, data] : rows) {
      sqlite3_stmt* statement = nullptr;
      sqlite3_prepare_v2(
          database, "INSERT INTO messages VALUES (?, ?, ?, ?)", -1, &statement, nullptr);
      sqlite3_bind_int(statement, 1, id);
      sqlite3_bind_int(statement, 2, topic);
      sqlite3_bind_int64(statement, 3, time);
      sqlite3_bind_blob(statement, 4, data.data(), static_cast<int>(data.size()), SQLITE_TRANSIENT);
      EXPECT_EQ(sqlite3_step(statement), SQLITE_DONE);
      sqlite3_finalize(statement);
    }
  }
  /// An open database; `head` are commands before its tables.
  sqlite3* Make(const std::string& name, const std::string& head = {}) const {
    sqlite3* database = nullptr;
    EXPECT_EQ(sqlite3_open(Path(name).c_str(), &database), SQLITE_OK);
    Execute(database,
            "PRAGMA synchronous = OFF;" + head +
                "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
                "serialization_format TEXT);"
                "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, "
                "timestamp INTEGER, data BLOB);"
                "INSERT INTO topics VALUES (4, '/left/image_raw', 'sensor_msgs/msg/Image', 'cdr'),"
                "(2, '/imu', 'sensor_msgs/msg/Imu', 'cdr'),"
                "(3, '/old', 'sensor_msgs/msg/Image', NULL);");
    return database;
  }
  static Row ImageRow(int i, int id, const std::string& data) {
    return {id, 4, (101 + i) * kSecond + 11 * i, data};
  }
};

TEST_F(Databases, HaveMessagesByTheirNumbers) {
  const std::string name = "a #?%41.db3";
  sqlite3* const database = Make(name);
  AddRows(database,
          {ImageRow(2, 30, CdrImage(2)),
           ImageRow(0, 10, CdrImage(0)),
           ImageRow(1, 20, Zstd(CdrImage(1))),
           {15, 2, 1, "imu"},
           {16, 99, 1, CdrImage(3)},
           {17, 3, 1, CdrImage(3)}});
  sqlite3_close(database);
  const auto file = OpenMessageFile(Path(name));
  EXPECT_THAT(file->Damage(), IsEmpty());
  std::vector<std::string> topics;
  for (const MessageTopic& topic : file->Topics()) {
    topics.push_back(fmt::format("{} {} {}", topic.name, topic.type, topic.count));
  }
  EXPECT_THAT(topics,
              ::testing::UnorderedElementsAre("/left/image_raw sensor_msgs/msg/Image 3",
                                              "/imu sensor_msgs/msg/Imu 1",
                                              "/old sensor_msgs/msg/Image 1"));
  ASSERT_EQ(file->Messages().size(), 4U);
  EXPECT_EQ(file->Messages()[1].stamp, 0);  // of a coding that is not known
  std::vector<std::string> images;
  for (const MessageRef& ref : file->Messages()) {
    images.push_back(TextOfBytes(file->Read(ref, 1000).bytes));
    // The beginning of a packed message is that of the message.
    EXPECT_TRUE(images.back().starts_with(TextOfBytes(file->Read(ref, 17).bytes).substr(0, 17)));
  }
  EXPECT_THAT(images, ElementsAre(CdrImage(0), CdrImage(3), CdrImage(1), CdrImage(2)));
  EXPECT_EQ(file->Messages()[2].stamp, 101 * kSecond + 10);
  EXPECT_EQ(file->Messages()[2].logged, 102 * kSecond + 11);
  EXPECT_EQ(file->Read(file->Messages()[0], 17).bytes.size(), 17U);
}

TEST_F(Databases, CountPackedMessagesThatAreDamaged) {
  sqlite3* const database = Make("a.db3");
  const std::string packed = Zstd(CdrImage(1));
  AddRows(database,
          {ImageRow(0, 1, CdrImage(0)),
           ImageRow(1, 2, packed.substr(0, packed.size() - 5)),
           ImageRow(1, 3, packed.substr(0, 4)),
           ImageRow(2, 4, CdrImage(2))});
  sqlite3_close(database);
  const auto file = OpenMessageFile(Path("a.db3"));
  EXPECT_THAT(file->Damage(), ElementsAre("2 messages about images are damaged"));
  ExpectImages(*file, {0, 2}, CdrImage);
  MessageRef ref = file->Messages()[0];
  for (const std::uint64_t row : {2, 77}) {
    ref.block = row;
    EXPECT_THAT(RefusalOf([&] { static_cast<void>(file->Read(ref, 1000)); }),
                ::testing::AllOf(HasSubstr(fmt::format("{}: message {} is damaged or larger than "
                                                       "960 MB (",
                                                       Path("a.db3").string(),
                                                       row)),
                                 EndsWith("); copy the file again")));
  }
  ref.block = 4;
  EXPECT_EQ(TextOfBytes(file->Read(ref, 1000).bytes), CdrImage(2));
}

TEST_F(Databases, HaveTheMessagesOfTheJournalBeside) {
  sqlite3* const database = Make("a.db3", "PRAGMA journal_mode = WAL;");
  AddRows(database, {ImageRow(0, 1, CdrImage(0))});
  ASSERT_GT(std::filesystem::file_size(Path("a.db3-wal")), 0U);
  ExpectImages(*OpenMessageFile(Path("a.db3")), {0}, CdrImage);
  sqlite3_close(database);
  ExpectImages(*OpenMessageFile(Path("a.db3")), {0}, CdrImage);
  // A file that is read leaves nothing beside it.
  EXPECT_FALSE(std::filesystem::exists(Path("a.db3-wal")));
}

TEST_F(Databases, OfOtherTablesAreRefused) {
  const std::string none =
      ": is a database, but none of rosbag2: it has no tables 'topics' and "
      "'messages'";
  const auto refusal = [&](const std::string& name, const std::string& text) {
    sqlite3* database = nullptr;
    EXPECT_EQ(sqlite3_open(Path(name).c_str(), &database), SQLITE_OK);
    Execute(database, text);
    sqlite3_close(database);
    return RefusalOf([&] { static_cast<void>(OpenMessageFile(Path(name))); });
  };
  EXPECT_EQ(refusal("a", "CREATE TABLE topics(id)"), Path("a").string() + none);
  EXPECT_EQ(refusal("b", "CREATE TABLE topics(id); CREATE VIEW messages AS SELECT 1 AS id"),
            Path("b").string() + none);
  std::string damaged(kDb3Magic);
  damaged += std::string(4096, 'x');
  EXPECT_THAT(RefusalOf([&] { static_cast<void>(Open(damaged)); }),
              ::testing::StartsWith(Path("file").string() + ": "));
}

TEST_F(Databases, AreReadUpToTheirDamage) {
  sqlite3* const database = Make("a.db3");
  std::vector<Row> rows;
  for (int i = 0; i < 40; ++i) rows.push_back(ImageRow(i % 10, i, CdrImage(i % 10) + Noisy(1000)));
  AddRows(database, rows);
  sqlite3_close(database);
  const auto size = std::filesystem::file_size(Path("a.db3"));
  std::filesystem::resize_file(Path("a.db3"), size / 2);
  const auto file = OpenMessageFile(Path("a.db3"));
  EXPECT_GT(file->Messages().size(), 5U);
  EXPECT_LT(file->Messages().size(), 35U);
  ASSERT_FALSE(file->Damage().empty());
  EXPECT_THAT(file->Damage()[0],
              ::testing::AllOf(::testing::StartsWith("is damaged or cut off ("),
                               EndsWith("); the messages after that are lost")));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
