// SPDX-License-Identifier: Apache-2.0
//
// What runs leave for later ones: detections, pictures, and whole results when they are killed.
#include <chrono>
#include <thread>

#include "tests/apps/chessboard_images.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

class Resume : public Images {
 protected:
  // The number of images whose detections a run takes over.
  [[nodiscard]] int Reused(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{"calibrate", "session.yaml", "-o", "out"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    const std::string before = "cam0: detections of ";
    const std::size_t place = outcome.err.find(before);
    return place == std::string::npos ? 0 : std::stoi(outcome.err.substr(place + before.size()));
  }

  [[nodiscard]] std::vector<fs::path> Entries() const {
    std::vector<fs::path> entries;
    for (const auto& entry : fs::directory_iterator(Path("out/.cache"))) {
      entries.push_back(entry.path());
    }
    return entries;
  }

  // What a calibration consists of, in one text; the cache may differ.
  [[nodiscard]] std::map<std::string, std::string> Result(const std::string& folder) const {
    std::map<std::string, std::string> files = Files(folder);
    std::erase_if(files, [](const auto& file) { return file.first.starts_with(".cache/"); });
    return files;
  }
};

TEST_F(Resume, ReusesDetectionsAndGivesTheSameResult) {
  EXPECT_EQ(Reused(), 0);
  const auto first = Result("out");
  EXPECT_EQ(Reused(), kImages);
  EXPECT_EQ(Result("out"), first);
}

TEST_F(Resume, DetectsAgainWhereAnImageChanged) {
  EXPECT_EQ(Reused(), 0);
  Save("images/03.png", ChessboardView(kImages));
  EXPECT_EQ(Reused(), kImages - 1);
  // Content decides, not names or times.
  fs::rename(Path("images/05.png"), Path("images/55.png"));
  EXPECT_EQ(Reused(), kImages);
}

TEST_F(Resume, DetectsAgainForAnotherTargetOtherWhiteImagesAndWhenAsked) {
  EXPECT_EQ(Reused(), 0);
  EXPECT_EQ(Reused({"--fresh"}), 0);
  EXPECT_EQ(Reused(), kImages);
  Save("white/0.png", cv::Mat(480, 640, CV_8UC1, cv::Scalar(180)));
  Write("session.yaml", Read("session.yaml") + "    white_images: white/*.png\n");
  EXPECT_EQ(Reused(), 0);
  EXPECT_EQ(Reused(), kImages);
  Write("target.yaml", Read("target.yaml") + "tolerance: 0.001\n");
  EXPECT_EQ(Reused(), 0);
}

TEST_F(Resume, NeverTrustsADamagedEntry) {
  EXPECT_EQ(Reused(), 0);
  const auto first = Result("out");
  const auto entries = Entries();
  ASSERT_EQ(entries.size(), static_cast<std::size_t>(kImages));
  const auto name = [](const fs::path& path) { return "out/.cache/" + path.filename().string(); };
  Write(name(entries[0]), "");
  Write(name(entries[1]), Read(name(entries[1])).substr(0, 100));
  std::string flipped = Read(name(entries[2]));
  flipped[flipped.size() / 2] ^= 1;
  Write(name(entries[2]), flipped);
  // One entry in another's place.
  fs::copy_file(entries[4], entries[3], fs::copy_options::overwrite_existing);
  EXPECT_EQ(Reused(), kImages - 4);
  EXPECT_EQ(Result("out"), first);
  EXPECT_EQ(Reused(), kImages);
}

TEST_F(Resume, RemovesWhatIsNoLongerNeeded) {
  EXPECT_EQ(Reused(), 0);
  for (int i = 4; i < kImages; ++i) fs::remove(Path(fmt::format("images/{:02}.png", i)));
  Write(fmt::format("out/.cache/{:032}.1.2", 0), "of an entry that a killed run wrote");
  EXPECT_EQ(Reused(), 4);
  EXPECT_EQ(Entries().size(), 4U);
}

TEST_F(Resume, ContinuesAfterAnInterrupt) {
  const Outcome outcome =
      Run({"calibrate", "session.yaml", "-o", "out", "--threads", "1"},
          {.interrupt_when = [this] { return fs::exists(Path("out/.cache")); }});
  EXPECT_EQ(outcome.status, kInterrupted) << outcome.err;
  EXPECT_THAT(Results("out"), ::testing::IsEmpty());
  EXPECT_GE(Reused(), 1);
}

TEST_F(Resume, KeepsPicturesOnRequest) {
  EXPECT_EQ(Reused(), 0);
  EXPECT_FALSE(fs::exists(Path("out/images")));
  EXPECT_EQ(Reused({"--keep"}), kImages);
  for (int i = 0; i < kImages; ++i) {
    const cv::Mat picture =
        cv::imread(Path(fmt::format("out/images/cam0/{:02}.png", i)).string(), cv::IMREAD_COLOR);
    ASSERT_FALSE(picture.empty());
    // Markers are drawn in green.
    cv::Mat green;
    cv::inRange(picture, cv::Scalar(0, 200, 0), cv::Scalar(80, 255, 80), green);
    EXPECT_GT(cv::countNonZero(green), kColumns * kRows * 5);
  }
}

/// Names of the files that two folders do not share.
std::string Differing(const std::map<std::string, std::string>& a,
                      const std::map<std::string, std::string>& b) {
  std::string names;
  for (const auto& [of, other] : {std::pair(&a, &b), std::pair(&b, &a)}) {
    for (const auto& [name, content] : *of) {
      const auto found = other->find(name);
      if (found == other->end() || found->second != content) names += " " + name;
    }
  }
  return names;
}

// Killed at any moment, a run leaves the results of before or all of its own, and the next
// finishes.
TEST_F(Resume, KilledLeavesTheOldResultOrTheNew) {
  const auto calibrate = [&](const RunOptions& options) {
    return Run({"calibrate", "session.yaml", "-o", "out", "--keep", "--quiet"}, options).status;
  };
  const std::string session = Read("session.yaml");
  const std::array<std::string, 2> sessions{session + "options: {loss: huber}\n",
                                            session + "options: {loss: cauchy}\n"};
  std::array<std::map<std::string, std::string>, 2> results;
  double seconds = 0;
  for (const std::size_t k : {0, 1}) {
    Write("session.yaml", sessions[k]);
    const auto start = std::chrono::steady_clock::now();
    ASSERT_EQ(calibrate({}), kDone);
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    results[k] = Result("out");
  }
  ASSERT_NE(results[0], results[1]);
  std::size_t before = 1;
  constexpr int kKills = 24;
  for (int i = 0; i < kKills; ++i) {
    const std::size_t now = 1 - before;
    Write("session.yaml", sessions[now]);
    // Half of them spread over the run, half while results are written.
    const auto start = std::chrono::steady_clock::now();
    const bool while_writing = i % 2 == 1;
    const auto time_has_come = [&] {
      const std::chrono::duration<double> since = std::chrono::steady_clock::now() - start;
      return while_writing ? fs::exists(Path("out/.partial/calibration.yaml"))
                           : since.count() > seconds * i / kKills;
    };
    const int status = calibrate({.interrupt_when = time_has_come, .signal = SIGKILL});
    ASSERT_TRUE(status == kDone || status == 128 + SIGKILL) << status;
    // The process that moves the files outlives the killed one by a moment.
    for (int wait = 0; wait < 100 && fs::exists(Path("out/.partial/complete")); ++wait) {
      bool all_moved = true;
      for (const auto& entry : fs::recursive_directory_iterator(Path("out/.partial"))) {
        all_moved = all_moved && (entry.is_directory() || entry.path().filename() == "complete");
      }
      if (all_moved) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    auto left = Result("out");
    std::erase_if(left, [](const auto& file) { return file.first.starts_with(".partial/"); });
    EXPECT_TRUE(left == results[before] || left == results[now])
        << i << ", differing from before: " << Differing(left, results[before])
        << "; from now: " << Differing(left, results[now]);
    if (left == results[now]) before = now;
  }
  Write("session.yaml", sessions[0]);
  ASSERT_EQ(calibrate({}), kDone);
  EXPECT_EQ(Result("out"), results[0]);
}

// A power cut while files are moved: some are moved, some not.
TEST_F(Resume, CompletesWhatWasAnnounced) {
  EXPECT_EQ(Reused(), 0);
  Write("out/.partial/poses.csv", "new poses");
  Write("out/.partial/images/cam0/x.png", "new picture");
  Write("out/.partial/complete", "");
  Write("session.yaml", Read("session.yaml") + "options: {loss: nonsense}\n");
  EXPECT_EQ(Run({"calibrate", "session.yaml", "-o", "out"}).status, kWrongInput);
  Write("session.yaml", Replaced(Read("session.yaml"), "nonsense", "huber"));
  Write("images/00.png", "");
  fs::remove_all(Path("images"));
  fs::create_directories(Path("images"));
  Write("images/00.png", "no image");
  EXPECT_EQ(Run({"calibrate", "session.yaml", "-o", "out"}).status, kJobFailed);
  EXPECT_EQ(Read("out/poses.csv"), "new poses");
  EXPECT_EQ(Read("out/images/cam0/x.png"), "new picture");
  EXPECT_FALSE(fs::exists(Path("out/.partial")));
}

TEST_F(Resume, RemovesWhatAKilledRunDidNotAnnounce) {
  EXPECT_EQ(Reused(), 0);
  const auto first = Result("out");
  Write("out/.partial/poses.csv", "half of the po");
  EXPECT_EQ(Reused(), kImages);
  EXPECT_EQ(Result("out"), first);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
