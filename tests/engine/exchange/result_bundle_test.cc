// SPDX-License-Identifier: Apache-2.0
//
// The archive of a result folder for a report of a fault.
#include "engine/exchange/result_bundle.h"

#include <gmock/gmock.h>

#include <map>

#include "engine/recording/stores/zip_archive.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Key;
using ::testing::Pair;

class ResultBundles : public InTemporaryFolder {
 protected:
  ResultBundles() {
    Write("elsewhere.csv", "not of this folder\n");
    Write("out/calibration.yaml",
          "plenocal: 1\nprovenance:\n  session_text: \"a: 1\\n\"\n  target_text: \"b: 2\\n\"\n");
    Write("out/detections_left.csv", "frame,marker,x,y\n");
    Write("out/.cache/entry.csv", "x\n");
    Write("out/images/left/1.png", "pixels");
    Write("out/bundle.zip", "an earlier one");
    Write("out/report.html", "page");
    fs::create_symlink(Path("elsewhere.csv"), Path("out/link.csv"));
  }
  [[nodiscard]] std::map<std::string, std::string> Bundled(bool pictures) const {
    Write("b.zip", ResultBundle(Path("out"), pictures));
    const ZipArchive archive(Path("b.zip"));
    std::map<std::string, std::string> files;
    for (size_t i = 0; i < archive.Names().size(); ++i) {
      const auto bytes = archive.Read(i).bytes;
      files[archive.Names()[i]] = {bytes.begin(), bytes.end()};
    }
    return files;
  }
};

TEST_F(ResultBundles, HaveSessionDetectionsAndResultButNoPicture) {
  EXPECT_THAT(Bundled(false),
              ElementsAre(Key("calibration.yaml"),
                          Pair("detections_left.csv", "frame,marker,x,y\n"),
                          Pair("nominal_target.yaml", "b: 2\n"),
                          Pair("session.yaml", "a: 1\n")));
  Write("out/session.yaml", "own\n");
  Write("out/nominal_target.yaml", "own target\n");
  EXPECT_EQ(Bundled(false)["session.yaml"], "own\n");
}

TEST_F(ResultBundles, HavePicturesWhenAskedFor) {
  auto files = Bundled(true);
  EXPECT_EQ(files.size(), 6U);
  EXPECT_EQ(files["images/left/1.png"], "pixels");
  EXPECT_EQ(files["report.html"], "page");
}

TEST_F(ResultBundles, AreEqualForEqualFilesOfAnyDate) {
  const std::string before = ResultBundle(Path("out"), true);
  fs::last_write_time(Path("out/report.html"),
                      fs::file_time_type::clock::now() - std::chrono::hours(99));
  EXPECT_EQ(ResultBundle(Path("out"), true), before);
}

TEST_F(ResultBundles, AreRefusedOfFoldersWithoutResults) {
  fs::create_directory(Path("empty"));
  for (const char* folder : {"empty", "none"}) {
    EXPECT_THAT(RefusalOf([&] { ResultBundle(Path(folder), true); }), HasSubstr(folder));
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
