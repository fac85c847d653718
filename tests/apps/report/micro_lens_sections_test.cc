// SPDX-License-Identifier: Apache-2.0
#include "apps/report/micro_lens_sections.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using Json = nlohmann::json;

// 8 columns and 6 rows of a lattice with e_column = (5.5, 0.3) and e_row = (0, 6), by turns `off`
// px to the right and to the left of it: no lattice explains that.
std::string Grid(double off, int columns = 8) {
  std::string csv = "row,column,x,y,type\n";
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < columns; ++column) {
      const double x = 10 + 5.5 * column + ((row + column) % 2 == 0 ? off : -off);
      csv += fmt::format(
          "{},{},{},{},{}\n", row, column, x, 7 + 0.3 * column + 6 * row, column == 3 ? 2 : 0);
    }
  }
  return csv;
}

TEST(MicroLensTable, HasTheDeviationsFromTheBestLattice) {
  const MicroLensTable table(Grid(0.125), "grid.csv");
  ASSERT_TRUE(table.HasLattice());
  const Json section = table.GridSection({60, 50});
  EXPECT_EQ(section["lenses"], 48);
  EXPECT_NEAR(section["rms"], 0.125, 1e-6);
  EXPECT_NEAR(section["pitch"], (std::hypot(5.5, 0.3) + 6) / 2, 1e-5);
  EXPECT_EQ(section["types"],
            Json::array({{{"type", 0}, {"lenses", 42}}, {{"type", 2}, {"lenses", 6}}}));
  EXPECT_FALSE(section["field"].is_null());
  EXPECT_NEAR(MicroLensTable(Grid(0), "grid.csv").GridSection({60, 50})["rms"], 0, 1e-6);
}

TEST(MicroLensTable, HasNoLatticeWithoutRowsOrOfFewMicroLenses) {
  const MicroLensTable places("x,y,type\n1,2,0\n3,4,0\n5,6,0\n7,8,0\n9,1,0\n2,3,0\n", "grid.csv");
  EXPECT_FALSE(places.HasLattice());
  EXPECT_TRUE(places.GridSection({60, 50}).is_null());
  const std::string six = Grid(0, 1);
  EXPECT_TRUE(MicroLensTable(six, "grid.csv").HasLattice());
  const size_t last = six.rfind('\n', six.size() - 2);
  EXPECT_FALSE(MicroLensTable(six.substr(0, last + 1), "grid.csv").HasLattice());
}

// The files have the centres with different decimals, which may be on both sides of a whole number.
TEST(MicroLensTable, KnowsTheTypesOfMicroLensesByTheirCentres) {
  const MicroLensTable table("x,y,type\n20.99,31.01,2\n20.99,40,1\n30.5,31,0\n", "grid.csv");
  CalibratedCamera camera;
  camera.model = FindModel(CameraModels(), "focused-plenoptic");
  for (const Eigen::Vector2d& centre :
       {Eigen::Vector2d(20.99, 31.01), {21.01, 30.99}, {21.02, 39.98}, {30.5, 31}, {30.5, 31.06}}) {
    camera.residuals.push_back({.values = {25, 35, centre.x(), centre.y()}});
  }
  EXPECT_THAT(table.TypesOf(camera), ElementsAre(2, 2, 1, 0, -1));
}

}  // namespace TEST_FILE
}  // namespace plenocal
