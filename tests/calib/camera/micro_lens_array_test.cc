// SPDX-License-Identifier: Apache-2.0
#include "calib/camera/micro_lens_array.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <pugixml.hpp>
#include <regex>
#include <string>
#include <string_view>

#include "calib/base/error.h"
#include "calib/camera/lens_lattice.h"
#include "calib/files/raytrix_grid.h"
#include "tests/optional_data.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

namespace fs = std::filesystem;
constexpr ImageSize kSize{300, 200};
constexpr double kPitch = 15;

MicroLensArray Example() {
  MicroLensArray array;
  array.image_size = kSize;
  array.types = 3;
  for (int row = -40; row <= 40; ++row) {
    for (int column = -60; column <= 60; ++column) {
      const Eigen::Vector2d centre(140 + kPitch * (column + 0.5 * row),
                                   90 + kPitch * row * std::sqrt(0.75));
      if (!IsInside(centre, kSize)) continue;
      array.lenses.push_back({.row = row,
                              .column = column,
                              .centre = centre,
                              .type = kThreeInterleaved.Set({column, row}),
                              .usable = column != 2});
    }
  }
  return array;
}

class MicroLensFile : public testing::InTemporaryFolder {
 protected:
  void Write(const std::string& text) const { files_.Write("array.csv", text); }
  [[nodiscard]] std::string Message() const {
    return testing::RefusalOf([&] { ReadMicroLenses(path_, kSize); });
  }

  const fs::path path_ = Path("array.csv");
};

TEST_F(MicroLensFile, ReadsWhatItWrites) {
  const MicroLensArray written = Example();
  Write(FormatMicroLenses(written));
  const MicroLensArray read = ReadMicroLenses(path_, kSize);
  ASSERT_EQ(read.lenses.size(), written.lenses.size());
  constexpr double kDigits = 1e-5;  // px, as written
  for (size_t i = 0; i < read.lenses.size(); ++i) {
    EXPECT_LT((read.lenses[i].centre - written.lenses[i].centre).norm(), kDigits);
    EXPECT_EQ(read.lenses[i].row, written.lenses[i].row);
    EXPECT_EQ(read.lenses[i].column, written.lenses[i].column);
    EXPECT_EQ(read.lenses[i].type, written.lenses[i].type);
    EXPECT_EQ(read.lenses[i].usable, written.lenses[i].usable);
  }
  EXPECT_EQ(read.types, 3);
  EXPECT_NEAR(read.Pitch(), kPitch, kDigits);
}

TEST_F(MicroLensFile, NumbersItsTypesFromZero) {
  MicroLensArray array = Example();
  for (MicroLens& lens : array.lenses) lens.type = 7 * lens.type - 5;
  Write(FormatMicroLenses(array));
  const MicroLensArray read = ReadMicroLenses(path_, kSize);
  EXPECT_EQ(read.types, 3);
  for (const MicroLens& lens : read.lenses) {
    EXPECT_EQ(lens.type, kThreeInterleaved.Set({lens.column, lens.row}));
  }
}

// What uses the types as indices has room for four.
TEST_F(MicroLensFile, WithMoreTypesThanALatticeHasSetsIsRefused) {
  MicroLensArray array = Example();
  array.lenses[20].type = 157;
  array.lenses[21].type = 158;
  Write(FormatMicroLenses(array));
  EXPECT_THAT(Message(), ::testing::HasSubstr(".csv:23: lens type 158 is one too many"));
}

TEST_F(MicroLensFile, FindsTheLatticeOfAFileWithoutRowsAndColumns) {
  std::string text = FormatMicroLenses(Example());
  const std::regex first_four_cells(R"(^([^,]*,[^,]*,[^,]*,[^,\n]*),.*)", std::regex::multiline);
  text = std::regex_replace(text, first_four_cells, "$1");
  Write(text);
  const MicroLensArray read = ReadMicroLenses(path_, kSize);
  EXPECT_NEAR(read.Pitch(), kPitch, 1e-4);
  for (const MicroLens& lens : read.lenses) {
    // Another origin, but the interleaved sets are the same up to their numbers.
    const int shift =
        kThreeInterleaved.Set({read.lenses[0].column, read.lenses[0].row}) - read.lenses[0].type;
    EXPECT_EQ((kThreeInterleaved.Set({lens.column, lens.row}) - lens.type - shift) % 3, 0);
  }
}

// Their rows would be 24 degrees from the columns.
TEST_F(MicroLensFile, WhoseRowsAndColumnsAreNotTheLatticesIsRefused) {
  MicroLensArray array = Example();
  for (MicroLens& lens : array.lenses) {
    lens.centre = Eigen::Vector2d(140, 90) + lens.column * Eigen::Vector2d(6, 0) +
                  lens.row * Eigen::Vector2d(5.5, 2.4);
  }
  std::erase_if(array.lenses, [](const MicroLens& lens) { return !IsInside(lens.centre, kSize); });
  Write(FormatMicroLenses(array));
  EXPECT_THAT(Message(), ::testing::EndsWith("rows and columns do not belong to the centres"));
}

// The lattice vectors alone are those of a rectangular lattice.
TEST_F(MicroLensFile, WithOddRowsThatBeginHalfAPitchFartherIsRefused) {
  MicroLensArray array = Example();
  for (MicroLens& lens : array.lenses) lens.column += (lens.row - (lens.row & 1)) / 2;
  Write(FormatMicroLenses(array));
  EXPECT_THAT(Message(), ::testing::EndsWith("rows and columns do not belong to the centres"));
}

TEST_F(MicroLensFile, WithOneOfSevenColumnNumbersIsRefused) {
  MicroLensArray array = Example();
  for (MicroLens& lens : array.lenses) lens.column -= lens.column % 7;
  Write(FormatMicroLenses(array));
  EXPECT_THAT(Message(), ::testing::EndsWith("rows and columns do not belong to the centres"));
}

// A polynomial of a high degree bends enough to fit them.
TEST_F(MicroLensFile, WhoseRowNumbersAreDoubledFromTheMiddleOnIsRefused) {
  MicroLensArray array = Example();
  for (MicroLens& lens : array.lenses) lens.row += std::max(0, lens.row - 1);
  Write(FormatMicroLenses(array));
  EXPECT_THAT(Message(), ::testing::EndsWith("rows and columns do not belong to the centres"));
}

TEST_F(MicroLensFile, TakesAMicroLensOnTheBorderOfTheSensor) {
  double last = 0;
  for (const MicroLens& lens : Example().lenses) last = std::max(last, lens.centre.x());
  std::string text = "index,x,y,type\n";
  int index = 0;
  for (const MicroLens& lens : Example().lenses) {
    double x = lens.centre.x() + (kSize[0] - 0.5 - last);
    // Rounding moves the place predicted for the last one of a row beside the sensor.
    if (last - lens.centre.x() > 0.1) x += 0.01 * (1 - (last - lens.centre.x()) / kSize[0]);
    text += std::to_string(index++) + "," + std::to_string(x) + "," +
            std::to_string(lens.centre.y()) + ",0\n";
  }
  Write(text);
  EXPECT_EQ(ReadMicroLenses(path_, kSize).lenses.size(), Example().lenses.size());
}

// As other programs list them.
TEST_F(MicroLensFile, TakesMicroLensesBesideTheImage) {
  std::string text = "index,x,y,type\n";
  int index = 0;
  for (int row = -12; row <= 12; ++row) {
    for (int column = -16; column <= 16; ++column) {
      text += std::to_string(index++) + "," +
              std::to_string(140 + kPitch * (column + row % 2 / 2.0)) + "," +
              std::to_string(90 + kPitch * row * std::sqrt(0.75)) + ",0\n";
    }
  }
  Write(text);
  EXPECT_EQ(ReadMicroLenses(path_, kSize).lenses.size(), 33U * 25);
}

TEST_F(MicroLensFile, NamesTheLineOfABadNumber) {
  Write("index,x,y,type\n0,1.5,2.5,0\n1,oops,2.5,0\n");
  EXPECT_THAT(Message(),
              ::testing::AllOf(::testing::HasSubstr(":3:3: x"), ::testing::HasSubstr("oops")));
}

TEST(RayCalibData, RealFilesGiveTheirPitchRotationAndTypes) {
  const fs::path folder = OptionalData("plenoptic_real");
  if (!fs::exists(folder)) GTEST_SKIP() << Absent(folder);
  struct Case {
    const char* file;
    double pitch, rotation_deg;  // modulo 60
  };
  for (const Case& c :
       {Case{"raytrix_xml_mit/tree_Calibration.xml", 23.213624954224, 30},
        Case{"plenoptic_toolbox2/sc2_klein.xml", 34.864704132080, 0},
        Case{"plenoptic_toolbox2/Cards2_20171204_162425627_0000008378_Processed.xml",
             38.3737792969,
             -2.54233651836e-5 * 180 / std::numbers::pi}}) {
    const MicroLensArray array = ReadRayCalibData(folder / c.file, {964, 670});
    EXPECT_EQ(array.types, 3);
    EXPECT_NEAR(array.Pitch(), c.pitch, 1e-4);
    const double angle =
        std::atan2(array.e_column.y(), array.e_column.x()) * 180 / std::numbers::pi;
    EXPECT_NEAR(std::remainder(angle - c.rotation_deg, 60), 0, 1e-5) << c.file;
    const double expected = 964 * 670 / (c.pitch * c.pitch * std::sqrt(0.75));
    EXPECT_NEAR(static_cast<double>(array.lenses.size()), expected, 0.1 * expected);
    // Written again, each number is that of RxLive but for the micro lens that <offset> names. One
    // file has its bases upside down.
    if (array.Pitch() > 38) continue;
    pugi::xml_document real, written;
    ASSERT_TRUE(real.load_file((folder / c.file).c_str()));
    ASSERT_TRUE(written.load_string(RayCalibDataXml(array).c_str()));
    for (const char* path : {"diameter",
                             "rotation",
                             "lens_base_x/x",
                             "lens_base_x/y",
                             "lens_base_y/x",
                             "lens_base_y/y",
                             "sub_grid_base/x",
                             "sub_grid_base/y",
                             "lens_type[@id='0']/offset/x",
                             "lens_type[@id='0']/offset/y",
                             "lens_type[@id='1']/offset/x",
                             "lens_type[@id='1']/offset/y",
                             "lens_type[@id='2']/offset/x",
                             "lens_type[@id='2']/offset/y"}) {
      const auto number = [&](const pugi::xml_document& document) {
        return document.child("RayCalibData").select_node(path).node().text().as_double(1e9);
      };
      EXPECT_NEAR(number(written), number(real), 2e-6) << c.file << ": " << path;
    }
  }
}

TEST(RayCalibData, IsReadAsItIsWritten) {
  // Degrees of the rows: near the x axis, then near the y axis on either side.
  for (const double turned : {4.6, -1.0, 14.0, 16.0, 29.5, -16.0, -29.5}) {
    for (const int types : {1, 3}) {
      MicroLensArray array;
      array.image_size = {400, 300};
      array.types = types;
      const Eigen::Vector2d origin(201.2, 148.7);
      const Eigen::Rotation2Dd sixty(std::numbers::pi / 3);
      const Eigen::Vector2d e_column =
          Eigen::Rotation2Dd(turned * std::numbers::pi / 180) * Eigen::Vector2d(17.36, 0);
      const Eigen::Vector2d e_row = 1.001 * (sixty * e_column);
      for (int row = -25; row <= 25; ++row) {
        for (int column = -25; column <= 25; ++column) {
          const Eigen::Vector2d c = origin + column * e_column + row * e_row;
          if (!IsInside(c, array.image_size)) continue;
          array.lenses.push_back(
              {.row = row,
               .column = column,
               .centre = c,
               .type = types == 1 ? 0 : (kThreeInterleaved.Set({column, row}) + 1) % 3});
        }
      }
      SetLatticeVectors(&array);
      const testing::TemporaryFolder files;
      const std::string text = RayCalibDataXml(array);
      // As RxLive writes it: bases along an axis, lens type 0 at the offset.
      const bool upright = std::abs(turned) < 15;
      EXPECT_THAT(
          text,
          ::testing::ContainsRegex(upright ? "<lens_base_x units=\"lens\">[^<]*<x>1.0000000*</x>"
                                           : "<lens_base_x units=\"lens\">[^<]*<x>-?0.0000000*</x>"
                                             "[^<]*<y>1.0000000*</y>"));
      EXPECT_THAT(text,
                  ::testing::ContainsRegex("<lens_type id=\"0\">[^<]*<offset units=\"lens\">"
                                           "[^<]*<x>-?0.0*</x>[^<]*<y>-?0.0*</y>"));
      const MicroLensArray read = ReadRayCalibData(files.Write("a.xml", text), array.image_size);
      EXPECT_EQ(read.types, types);
      ASSERT_EQ(read.lenses.size(), array.lenses.size());
      size_t checked = 0;
      for (const MicroLens& lens : array.lenses) {
        for (const MicroLens& other : read.lenses) {
          if ((lens.centre - other.centre).norm() > 1e-6) continue;
          EXPECT_EQ(other.type, lens.type);
          ++checked;
        }
      }
      EXPECT_EQ(checked, array.lenses.size()) << turned;
    }
  }
}

TEST(RayCalibData, HoldsNoRowsOfLensTypes) {
  MicroLensArray array;
  array.image_size = {100, 100};
  array.types = 2;
  array.e_column = {20, 0};
  array.e_row = Eigen::Rotation2Dd(std::numbers::pi / 3) * array.e_column;
  for (int row = -2; row <= 2; ++row) {
    array.lenses.push_back({.row = row,
                            .centre = {50 + row * array.e_row.x(), 50 + row * array.e_row.y()},
                            .type = row & 1});
  }
  EXPECT_THROW(RayCalibDataXml(array), Error);
}

TEST(RayCalibData, HoldsNoRectangularLattice) {
  MicroLensArray array;
  array.e_column = {20, 0};
  array.e_row = {0, 20};
  EXPECT_THROW(RayCalibDataXml(array), Error);
}

/// A file of RxLive of one lens type, 20 px apart in an image of 300 x 200, with a line replaced.
std::string RayCalibDataOf(std::string_view old = {}, std::string_view other = {}) {
  std::string text =
      "<RayCalibData version=\"1.0\">\n"
      "  <offset><x>3</x><y>-2</y></offset>\n"
      "  <diameter>20</diameter>\n"
      "  <rotation>0.1</rotation>\n"
      "  <lens_base_x><x>1</x><y>0</y></lens_base_x>\n"
      "  <lens_base_y><x>0.5</x><y>0.8660254</y></lens_base_y>\n"
      "  <lens_type id=\"7\"><offset><x>0</x><y>0</y></offset></lens_type>\n"
      "</RayCalibData>\n";
  if (!old.empty()) text.replace(text.find(old), old.size(), other);
  return text;
}

MicroLensArray ReadRayCalibText(const std::string& text) {
  const testing::TemporaryFolder files;
  return ReadRayCalibData(files.Write("a.xml", text), kSize);
}

TEST(RayCalibData, HasYUpAndAnglesToTheLeft) {
  const MicroLensArray array = ReadRayCalibText(RayCalibDataOf());
  EXPECT_EQ(array.types, 1);
  // The rotation turns the bases; a sixth of a turn more is the same lattice.
  const Eigen::Vector2d e = 20 * Eigen::Vector2d(std::cos(0.1), -std::sin(0.1));
  EXPECT_LT((array.e_column - e).norm(), 1e-5);
  EXPECT_LT((array.e_row - Eigen::Rotation2Dd(std::numbers::pi / 3) * e).norm(), 1e-5);
  const auto middle = std::ranges::find_if(
      array.lenses, [](const MicroLens& lens) { return lens.row == 0 && lens.column == 0; });
  ASSERT_NE(middle, array.lenses.end());
  EXPECT_LT((middle->centre - Eigen::Vector2d(149.5 + 3, 99.5 + 2)).norm(), 1e-9);
  const MicroLensArray turned =
      ReadRayCalibText(RayCalibDataOf("0.1<", std::to_string(0.1 + std::numbers::pi / 3) + "<"));
  EXPECT_LT((turned.e_column - array.e_column).norm(), 1e-4);
}

TEST(RayCalibData, OfAnotherLatticeIsRefused) {
  const auto refused = [](std::string_view old, std::string_view other) {
    return testing::RefusalOf([&] { ReadRayCalibText(RayCalibDataOf(old, other)); });
  };
  using ::testing::HasSubstr;
  EXPECT_EQ(refused("<x>3<", "<x>4<"), "no refusal");
  // Bases of a rectangle, and of a hexagon that is a fifth too long on one side.
  EXPECT_THAT(refused("<x>0.5</x><y>0.8660254", "<x>0</x><y>1"), HasSubstr("no hexagonal lattice"));
  EXPECT_THAT(refused("<x>1</x>", "<x>1.2</x>"), HasSubstr("no hexagonal lattice"));
  EXPECT_EQ(refused("<x>0.5</x>", "<x>-0.5</x>"), "no refusal") << "120 degrees apart";
  EXPECT_THAT(refused("<diameter>20", "<diameter>3.9"), HasSubstr("at least 4 pixels"));
  EXPECT_EQ(refused("<diameter>20", "<diameter>50"), "no refusal");
  EXPECT_THAT(refused("<diameter>20", "<diameter>50.1"), HasSubstr("at most a quarter"));
  EXPECT_THAT(refused("<diameter>20", "<diameter>wide"), HasSubstr("expected a number"));
  EXPECT_THAT(refused("<rotation>0.1", "<rotation>left"), HasSubstr("expected a number"));
  EXPECT_THAT(refused("<diameter>20", "<diameter>20 mm"), HasSubstr("expected a number"));
  EXPECT_EQ(refused("<diameter>20<", "<diameter>\n 20 <"), "no refusal");
  EXPECT_THAT(refused("id=\"7\"", "id=\"near\""), HasSubstr("id: expected a whole number"));
  EXPECT_THAT(refused("<x>3<", "<x>501<"), HasSubstr("outside of the image"));
  EXPECT_THAT(refused("<rotation>0.1</rotation>", ""), HasSubstr("<rotation>"));
  EXPECT_THAT(
      refused("<x>0</x><y>0</y></offset></lens_type>", "<x>0</x><y>1001</y></offset></lens_type>"),
      HasSubstr("no neighbouring lens"));
  EXPECT_THAT(
      refused("</lens_type>\n",
              "</lens_type><lens_type id=\"8\"><offset><x>1</x><y>0</y></offset></lens_type>\n"),
      HasSubstr("has 2 interleaved"));
}

TEST(LatticeVectors, AreThoseInTheMiddleOfTheImage) {
  // A lens makes the pitch smaller to the right.
  const auto place = [](int column, int row) -> Eigen::Vector2d {
    const double x = 16 * (column + 0.5 * row);
    return {150 + x - 0.0005 * x * x, 100 + 13.9 * row};
  };
  MicroLensArray array;
  array.image_size = {400, 200};
  for (int row = -9; row <= 9; ++row) {
    for (int column = -15; column <= 25; ++column) {
      const Eigen::Vector2d centre = place(column, row);
      if (!IsInside(centre, array.image_size)) continue;
      array.lenses.push_back({.row = row, .column = column, .centre = centre});
    }
  }
  SetLatticeVectors(&array);
  // x - 0.0005 x^2 = 49.5 at x = 50.8.
  const double x = (1 - std::sqrt(1 - 4 * 0.0005 * 49.5)) / (2 * 0.0005);
  EXPECT_LT((array.e_column - Eigen::Vector2d(16 * (1 - 0.001 * x), 0)).norm(), 1e-6);
  EXPECT_LT((array.e_row - Eigen::Vector2d(8 * (1 - 0.001 * x), 13.9)).norm(), 1e-6);
}

TEST(RayCalibData, SaysWhatIsWrong) {
  EXPECT_THAT(testing::RefusalOf([] { ReadRayCalibText("<Other/>"); }),
              ::testing::HasSubstr("RayCalibData"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
