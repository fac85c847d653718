// SPDX-License-Identifier: Apache-2.0
#include "calib/io/detection_cache.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <iterator>
#include <optional>
#include <string>

#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

namespace fs = std::filesystem;

class Cache : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] DetectionCache Open(bool fresh = false) const { return {cache_, "1.0", fresh}; }
  [[nodiscard]] std::string Key() const { return Open().Key({"markers", "image"}); }
  void Put(const fs::path& name, const std::string& content) const {
    Write(("cache" / name).string(), content);
  }

  const fs::path cache_ = Path("cache");
};

TEST_F(Cache, KeysDifferWhereAnyPartProgramOrBoundaryDoes) {
  EXPECT_EQ(Key().size(), 32U);
  EXPECT_EQ(Open().Key({"markers", "image"}), Key());
  EXPECT_NE(Open().Key({"markers", "imagf"}), Key());
  EXPECT_NE(Open().Key({"marker", "simage"}), Key());
  EXPECT_NE(Open().Key({"image", "markers"}), Key());
  EXPECT_NE(Open().Key({"markers"}), Key());
  EXPECT_NE(DetectionCache(cache_, "1.1", false).Key({"markers", "image"}), Key());
  EXPECT_EQ(Open().Key({"markers", ""}), "");
}

TEST_F(Cache, GivesBackWhatWasSaved) {
  DetectionCache cache = Open();
  EXPECT_EQ(cache.Load(Key()), std::nullopt);
  EXPECT_FALSE(fs::exists(cache_)) << "the folder is made with the first entry";
  const std::string content("a\0b\n", 4);
  cache.Save(Key(), content);
  EXPECT_EQ(cache.Load(Key()), content);
  EXPECT_EQ(Open().Load(Key()), content);
  cache.Save(Key(), "");
  EXPECT_EQ(Open().Load(Key()), "");
  EXPECT_EQ(std::distance(fs::directory_iterator(cache_), {}), 1);
}

TEST_F(Cache, IgnoresEntriesOfEarlierRunsWhenFresh) {
  const std::string other = Open().Key({"markers", "another"});
  Open().Save(Key(), "old");
  Open().Save(other, "old");
  DetectionCache fresh = Open(true);
  EXPECT_EQ(fresh.Load(Key()), std::nullopt);
  fresh.Save(Key(), "new");
  EXPECT_EQ(fresh.Load(Key()), "new");
  EXPECT_EQ(fresh.Load(other), std::nullopt);
}

TEST_F(Cache, TakesADamagedEntryForAbsent) {
  Open().Save(Key(), "content");
  const std::string entry = files_.Read("cache/" + Key());
  for (size_t i = 0; i < entry.size(); ++i) {
    std::string damaged = entry;
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
    Put(Key(), damaged);
    EXPECT_EQ(Open().Load(Key()), std::nullopt) << i;
    Put(Key(), entry.substr(0, i));
    EXPECT_EQ(Open().Load(Key()), std::nullopt) << i;
  }
  Put(Key(), entry);
  EXPECT_EQ(Open().Load(Key()), "content");
  // Another key's entry.
  const std::string other = Open().Key({"markers", "another"});
  Put(other, entry);
  EXPECT_EQ(Open().Load(other), std::nullopt);
}

TEST_F(Cache, RemovesEntriesAndTemporaryFilesThatTheRunHasNotUsed) {
  const auto key = [&](const char* part) { return Open().Key({part}); };
  for (const char* part : {"loaded", "unused", "damaged"}) Open().Save(key(part), part);
  Put(key("damaged"), "");
  Put(key("killed") + ".123.0", "part");
  Put("notes.txt", "mine");
  Put(key("upper") + "X", "mine");
  DetectionCache cache = Open();
  EXPECT_TRUE(cache.Load(key("loaded")));
  EXPECT_FALSE(cache.Load(key("damaged")));
  cache.Save(key("saved"), "saved");
  cache.RemoveUnused();
  EXPECT_EQ(std::distance(fs::directory_iterator(cache_), {}), 4);
  for (const std::string& kept :
       {key("loaded"), key("saved"), std::string("notes.txt"), key("upper") + "X"}) {
    EXPECT_TRUE(fs::exists(cache_ / kept)) << kept;
  }
}

TEST_F(Cache, RemovesItsEmptyFolderButNothingBehindALink) {
  Open().Save(Key(), "content");
  const fs::path link = Path("link");
  fs::create_directory_symlink(cache_, link);
  DetectionCache(link, "1.0", false).RemoveUnused();
  EXPECT_TRUE(fs::exists(cache_ / Key()));
  Open().RemoveUnused();
  EXPECT_FALSE(fs::exists(cache_));
}

TEST_F(Cache, KeepsNothingWithoutAFolderOrAKey) {
  DetectionCache none({}, "1.0", false);
  none.Save(Key(), "content");
  EXPECT_EQ(none.Load(Key()), std::nullopt);
  DetectionCache cache = Open();
  cache.Save("", "content");
  EXPECT_EQ(cache.Load(""), std::nullopt);
  EXPECT_FALSE(fs::exists(cache_));
}

TEST_F(Cache, HashesContents) {
  Put("a", "content");
  Put("b", "content");
  Put("c", "contenu");
  EXPECT_EQ(HashFile(cache_ / "a"), HashFile(cache_ / "b"));
  EXPECT_NE(HashFile(cache_ / "a"), HashFile(cache_ / "c"));
  const std::string text = "content";
  EXPECT_EQ(HashFile(cache_ / "a"),
            HashBytes({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
  EXPECT_EQ(HashFile(cache_ / "none"), "");
}

}  // namespace TEST_FILE
}  // namespace plenocal
