// SPDX-License-Identifier: Apache-2.0
//
// Advice about a target that is missing or wrong.
#include "engine/session/proposal_text.h"

#include <gmock/gmock.h>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

TEST(ProposalTexts, CountImages) {
  EXPECT_EQ(OfImages(1, 1), "the image");
  EXPECT_EQ(OfImages(2, 2), "all 2 images");
  EXPECT_EQ(OfImages(1, 2), "1 of 2 images");
  EXPECT_EQ(OfImages(0, 1), "0 of 1 images");
}

// ---- what to change

Target TargetOf(const std::string& keys) {
  return ReadTarget(YamlNode::Parse("plenocal: 1\n" + keys, "t"));
}

TargetProposals Proposed(const std::string& keys, size_t images = 5, size_t looked_at = 6) {
  return {.found = {{.what = "chessboard with 9 x 6 inner corners",
                     .shows = "9 x 6 inner corners",
                     .keys = keys,
                     .images = images}},
          .looked_at = looked_at};
}

constexpr const char* kBoard = "type: chessboard\ncolumns: 8\nrows: 6\nsquare: 25mm\n";

TEST(ProposalTexts, NameTheKeysThatDiffer) {
  const Target board = TargetOf(kBoard);
  EXPECT_EQ(MendOf(Proposed("type: chessboard\ncolumns: 9\nrows: 6\n"), board),
            "5 of 6 images show 9 x 6 inner corners: set columns: 9 (target_layout)");
  EXPECT_EQ(MendOf(Proposed("type: chessboard\ncolumns: 9\nrows: 7\n", 6), board),
            "all 6 images show 9 x 6 inner corners: set columns: 9, rows: 7 (target_layout)");
  EXPECT_EQ(MendOf(Proposed("type: chessboard\ncolumns: 8\nrows: 6\n"), board), "");
  EXPECT_EQ(MendOf(Proposed(""), board), "");
  EXPECT_EQ(MendOf({.found = {}, .looked_at = 3}, board), "");
  // A key that the target has not, and one without a code.
  EXPECT_EQ(MendOf(Proposed("type: chessboard\nlegacy: true\n"), board),
            "5 of 6 images show 9 x 6 inner corners: set legacy: true (target_legacy)");
  EXPECT_EQ(MendOf(Proposed("type: chessboard\nodd: 1\nrows: 7\n"), board),
            "5 of 6 images show 9 x 6 inner corners: set odd: 1, rows: 7 (target_layout)");
  EXPECT_EQ(MendOf(Proposed("type: chessboard\nodd: 1\n"), board),
            "5 of 6 images show 9 x 6 inner corners: set odd: 1");
}

TEST(ProposalTexts, NameATargetOfAnotherType) {
  EXPECT_EQ(MendOf(Proposed("type: aprilgrid\ncolumns: 9\n"), TargetOf(kBoard)),
            "5 of 6 images show chessboard with 9 x 6 inner corners: set type: aprilgrid, "
            "columns: 9");
}

TEST(ProposalTexts, NeedHalfOfTheImages) {
  EXPECT_EQ(MendOf(Proposed("type: chessboard\ncolumns: 9\n", 1, 1), TargetOf(kBoard)),
            "the image shows 9 x 6 inner corners: set columns: 9 (target_layout)");
  const std::string keys = "type: chessboard\ncolumns: 9\n";
  EXPECT_NE(MendOf(Proposed(keys, 3, 6), TargetOf(kBoard)), "");
  EXPECT_EQ(MendOf(Proposed(keys, 2, 6), TargetOf(kBoard)), "");
  EXPECT_EQ(MendOf(Proposed(keys, 3, 7), TargetOf(kBoard)), "");
}

TEST(ProposalTexts, KnowTheDefaultsOfAnAprilGrid) {
  const Target grid = TargetOf("type: aprilgrid\ncolumns: 6\nrows: 6\nsize: 50mm\nspacing: 0.3\n");
  const auto mend = [&](const std::string& keys) {
    return MendOf(Proposed("type: aprilgrid\n" + keys), grid);
  };
  EXPECT_EQ(mend("family: tag36h11\nborder_bits: 2\nfirst_id: 0\n"), "");
  const std::string start = "5 of 6 images show 9 x 6 inner corners: set ";
  EXPECT_EQ(mend("family: tag25h9\n"), start + "family: tag25h9");
  EXPECT_EQ(mend("border_bits: 1\n"), start + "border_bits: 1 (target_border_bits)");
  EXPECT_EQ(mend("first_id: 7\n"), start + "first_id: 7 (target_layout)");
}

// ---- no target

class MissingTargets : public InTemporaryFolder {
 protected:
  /// A chessboard of 5 x 4 inner corners as PGM.
  static std::string Board() {
    std::string image = "P5\n160 130\n255\n";
    for (int y = 0; y < 130; ++y) {
      for (int x = 0; x < 160; ++x) {
        const int column = (x - 20) / 20, row = (y - 15) / 20;
        const bool inside = x >= 20 && y >= 15 && column < 6 && row < 5;
        image += static_cast<char>(inside && (column + row) % 2 == 0 ? 30 : 210);
      }
    }
    return image;
  }
  std::string Refusal(const std::vector<std::vector<std::string>>& images) {
    plenocal::Run run;
    run.threads = 1;
    run.listener.progress = [&](const std::string& stage, size_t done, size_t total) {
      stage_ = stage;
      done_ = done;
      total_ = total;
    };
    return RefusalOf([&] { FailWithProposal({"left", "right"}, images, run); });
  }
  [[nodiscard]] std::string In(const std::string& name) const { return Path(name).string(); }
  std::string stage_;
  size_t done_ = 0, total_ = 0;
};

TEST_F(MissingTargets, AreProposedByTheImages) {
  Write("l/1.pgm", Board());
  Write("r/1.pgm", "P5\n32 24\n255\n" + std::string(32 * 24, 'd'));
  EXPECT_EQ(Refusal({{In("l")}, {In("r")}}),
            "--target is missing: chessboard with 5 x 4 inner corners in 1 of 2 images; state the "
            "square: --target chessboard:5x4:SIZE");
  EXPECT_EQ(stage_, "looking for a target");
  EXPECT_EQ(done_, 2U);
  EXPECT_EQ(total_, 2U);
  EXPECT_EQ(Refusal({{In("r")}, {}}),
            "--target is missing, and the image shows no chessboard, ChArUco board, AprilTag or "
            "grid of circles; state it, such as --target chessboard:9x6:25mm");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
