// SPDX-License-Identifier: Apache-2.0
//
// What the workbench shows of a run, against the run's files.
#include "apps/workbench/run_json.h"

#include <gmock/gmock.h>

#include <cmath>
#include <map>
#include <set>

#include "engine/session/calibration_folder.h"
#include "tests/apps/workspace.h"

namespace plenocal::workbench {
namespace TEST_FILE {

using ::plenocal::testing::kDone;
using ::plenocal::testing::Outcome;
using ::plenocal::testing::Table;
using ::testing::HasSubstr;
using Json = nlohmann::json;

class RunJsonOfAPair : public ::plenocal::testing::Workspace {
 protected:
  RunJsonOfAPair() {
    WriteProblem(::plenocal::testing::EasyProblem(2));
    Calibrate();
  }

  // Rows of residuals.csv.
  struct Row {
    std::string camera, frame;
    int marker = 0;
    double x = 0, y = 0, dx = 0, dy = 0;
    bool used = false;
  };
  [[nodiscard]] std::vector<Row> Rows() const {
    const Table table(Read("out/residuals.csv"));
    const auto cameras = table.Column("camera"), frames = table.Column("frame"),
               used = table.Column("used");
    const auto markers = table.Numbers("marker"), x = table.Numbers("x"), y = table.Numbers("y"),
               dx = table.Numbers("dx"), dy = table.Numbers("dy");
    std::vector<Row> rows;
    for (size_t i = 0; i < table.Rows(); ++i) {
      rows.push_back({cameras[i],
                      frames[i],
                      static_cast<int>(markers[i]),
                      x[i],
                      y[i],
                      dx[i],
                      dy[i],
                      used[i] != "0" && used[i] != "false"});
    }
    return rows;
  }
};

TEST_F(RunJsonOfAPair, IsBriefInAList) {
  const Json brief = RunBriefJson(Path("out"), 7);
  EXPECT_EQ(brief["run"], 7);
  EXPECT_EQ(brief["models"], Json({"pinhole-radial3", "pinhole-radial3"}));
  const YAML::Node result = Result();
  EXPECT_EQ(brief["grade"], result["verdict"]["grade"].as<std::string>());
  for (size_t c = 0; c < 2; ++c) {
    const YAML::Node written = result["cameras"]["cam" + std::to_string(c)]["residuals"]["rms"];
    EXPECT_NEAR(brief["rms"][c].get<double>(), written.as<double>(), 1e-9);
  }
  double largest = 0;
  for (const YAML::Node& finding : result["verdict"]["findings"]) {
    if (finding["code"].as<std::string>() != "projection") continue;
    largest = std::max(largest, finding["value"].as<double>());
  }
  EXPECT_NEAR(brief["projection"].get<double>(), largest, 1e-9);
  EXPECT_FALSE(brief.contains("problem"));
  Write("out/calibration.yaml", "plenocal: 1\ncameras: [");
  const Json broken = RunBriefJson(Path("out"), 8);
  EXPECT_EQ(broken["run"], 8);
  EXPECT_THAT(broken["problem"].get<std::string>(), HasSubstr("calibration.yaml"));
}

TEST_F(RunJsonOfAPair, HasTheFramesOfEachCamera) {
  const Json run = RunJson(Path("out"), 3);
  EXPECT_EQ(run["run"], 3);
  EXPECT_EQ(run["folder"], Path("out").string());
  for (const std::string camera : {"cam0", "cam1"}) {
    std::map<std::string, int> points;
    for (const Row& row : Rows()) points[row.frame] += row.camera == camera && row.used ? 1 : 0;
    const Json& frames = run["cameras"][camera]["frames"];
    ASSERT_EQ(frames["frame"].size(), points.size());
    for (size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(frames["points"][i], points.at(frames["frame"][i].get<std::string>()));
    }
  }
}

TEST_F(RunJsonOfAPair, HasThePointsOfAnImage) {
  const std::string frame = Rows().back().frame;
  const Json points = PointsJson(Path("out"), "cam1", frame);
  EXPECT_EQ(points["camera"], "cam1");
  EXPECT_EQ(points["frame"], frame);
  size_t i = 0;
  for (const Row& row : Rows()) {
    if (row.camera != "cam1" || row.frame != frame) continue;
    ASSERT_LT(i, points["points"].size());
    const Json& point = points["points"][i++];
    EXPECT_EQ(point[0], row.marker);
    const double expected[] = {row.x, row.y, row.dx, row.dy};
    for (size_t k = 0; k < 4; ++k) EXPECT_NEAR(point[k + 1].get<double>(), expected[k], 1e-9);
    EXPECT_EQ(point[5], row.used ? 1 : 0);
  }
  EXPECT_EQ(i, points["points"].size());
}

TEST_F(RunJsonOfAPair, NamesTheFrameOfTheLargestResidualOfAMarker) {
  std::map<int, std::pair<double, std::string>> largest;
  for (const Row& row : Rows()) {
    if (row.camera != "cam0") continue;
    auto& [length, frame] = largest[row.marker];
    if (!row.used || std::hypot(row.dx, row.dy) <= length) continue;
    length = std::hypot(row.dx, row.dy);
    frame = row.frame;
  }
  const Json residuals = ResidualsJson(Path("out"), "cam0");
  const Json& markers = residuals["markers"];
  ASSERT_EQ(markers["worst"].size(), largest.size());
  size_t i = 0;
  for (const auto& [marker, of_marker] : largest) {
    EXPECT_EQ(markers["marker"][i], marker);
    EXPECT_EQ(markers["worst"][i++], of_marker.second);
  }
  EXPECT_TRUE(residuals["field"].is_object());
}

TEST_F(RunJsonOfAPair, HasTheInfluenceOfEachFrame) {
  const Json influence = InfluenceJson(Path("out"));
  EXPECT_TRUE(influence["why"].is_null());
  std::set<std::string> frames, named;
  for (const Row& row : Rows()) frames.insert(row.frame);
  for (const Json& each : influence["frames"]) {
    named.insert(each["frame"].get<std::string>());
    EXPECT_GT(each["sigmas"], 0);
    EXPECT_LT(each["sigmas"], 10);
    EXPECT_FALSE(each["unknown"].get<std::string>().empty());
  }
  EXPECT_EQ(named, frames);
}

TEST_F(RunJsonOfAPair, ShowsWhatItWouldBeWithoutExcludedPoints) {
  const auto no_images = [](const std::string&) { return std::vector<FrameImage>(); };
  Session session;
  EXPECT_TRUE(PreviewJson(Path("out"), session, no_images).is_null());
  const std::vector<Row> rows = Rows();
  const std::string frame = rows.front().frame;
  // A frame of one camera, and one point of another frame of the other camera.
  session.exclude = {
      {.camera = "cam0", .frame = frame},
      {.camera = "cam1", .frame = rows.back().frame, .markers = {rows.back().marker}}};
  size_t points = 0;
  for (const Row& row : rows) {
    const bool excluded = row.camera == "cam0"
                              ? row.frame == frame
                              : row.frame == rows.back().frame && row.marker == rows.back().marker;
    points += excluded && row.used ? 1 : 0;
  }
  const Json preview = PreviewJson(Path("out"), session, no_images);
  EXPECT_EQ(preview["points"], points);
  EXPECT_GT(preview["sigma"][1], preview["sigma"][0]);  // less is known without them
  EXPECT_NE(preview["rms"][1], preview["rms"][0]);
  EXPECT_GT(preview["sigmas"], 0);
  EXPECT_THAT(preview["unknown"].get<std::string>(), ::testing::Not(::testing::IsEmpty()));
}

TEST_F(RunJsonOfAPair, HasMapsOfItsCamerasAlone) {
  const Json maps = MapsJson(Path("out"), "cam1");
  EXPECT_FALSE(maps.empty());
  EXPECT_TRUE(MapsJson(Path("out"), "cam2").empty());
  EXPECT_NE(maps, MapsJson(Path("out"), "cam0"));
}

TEST_F(RunJsonOfAPair, HasItsDifferencesFromAnotherByCameraAndDistance) {
  const CalibrationRecord a = OpenCalibrationFolder(Path("out"));
  CalibrationRecord b = a;
  b.cameras[1].params[0] *= 1.02;
  const Json differences = DifferenceJson(CompareCalibrations(a, b, {2}));
  ASSERT_EQ(differences.size(), 2);
  EXPECT_EQ(differences[0]["camera"], "cam0");
  EXPECT_EQ(differences[1]["camera"], "cam1");
  EXPECT_EQ(differences[0]["distance"], 2);
  EXPECT_LT(differences[0]["rms"], 1e-6);
  EXPECT_FALSE(differences[0]["differs"].get<bool>());
  EXPECT_GT(differences[1]["rms"], 0.1);
  EXPECT_TRUE(differences[1]["differs"].get<bool>());
  EXPECT_EQ(differences[1]["image_size"], Json(a.cameras[1].image_size));
}

TEST_F(RunJsonOfAPair, IsReadAgainWhenItIsMadeAgain) {
  const auto first = RecordOf(Path("out"));
  EXPECT_EQ(RecordOf(Path("out")), first);
  const auto later =
      std::filesystem::last_write_time(Path("out/calibration.yaml")) + std::chrono::seconds(2);
  std::filesystem::last_write_time(Path("out/calibration.yaml"), later);
  EXPECT_NE(RecordOf(Path("out")), first);
  std::filesystem::copy(Path("out"), Path("other"));
  const auto second = RecordOf(Path("out"));
  EXPECT_NE(RecordOf(Path("other")), second);
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
