// SPDX-License-Identifier: Apache-2.0
//
// docs/formats.md against the program: what the readers accept and what the writers write is what
// the page has, no more and no less.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "calib/files/detections.h"
#include "tests/apps/calibration_schema.h"
#include "tests/apps/chessboard_images.h"
#include "tests/apps/scene/small_loop.h"
#include "tests/apps/workspace.h"
#include "tests/calib/plenoptic_synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using Names = std::set<std::string>;
namespace fs = std::filesystem;

std::string FileText(const fs::path& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// What stands between backticks in the first cell of a table's row.
Names NamesInFirstCell(const std::string& row) {
  static const std::regex kQuoted("`([^`]+)`");
  const std::string cell = row.substr(1, row.find('|', 1) - 1);
  Names names;
  for (std::sregex_iterator it(cell.begin(), cell.end(), kQuoted), end; it != end; ++it) {
    names.insert((*it)[1].str());
  }
  return names;
}

/// The page: heading ("Keys of `residuals`") to the names in the tables below it.
std::map<std::string, Names> ReadPage() {
  std::map<std::string, Names> sections;
  std::string heading;
  for (const std::string& line : Lines(FileText(fs::path(PLENOCAL_DOCS) / "formats.md"))) {
    if (line.starts_with("#")) {
      heading = line.substr(line.find_first_not_of("# "));
      sections[heading];
    } else if (line.starts_with("|")) {
      sections[heading].merge(NamesInFirstCell(line));
    }
  }
  return sections;
}

/// How the maps under a key are documented.
enum class Below { kMap, kMapOfMaps, kListOfMaps, kFree };
struct Child {
  std::string key;
  Below below;
  std::string heading = {};  ///< without for kFree: names that the user or a model chooses
};

const std::map<std::string, std::vector<Child>>& Children() {
  static const std::map<std::string, std::vector<Child>> kChildren{
      {"Keys of calibration.yaml",
       {{"models", Below::kFree},
        {"cameras", Below::kMapOfMaps, "Keys of a camera in calibration.yaml"},
        {"adjustment", Below::kMap, "Keys of `adjustment`"},
        {"jitter", Below::kMap, "Keys of `jitter`"},
        {"undetermined", Below::kListOfMaps, "Keys of an item of `undetermined`"},
        {"targets", Below::kMapOfMaps, "Keys of a target in calibration.yaml"},
        {"target_scale", Below::kFree},
        {"weak", Below::kListOfMaps, "Keys of an item of `weak`"},
        {"verdict", Below::kMap, "Keys of `verdict`"},
        {"provenance", Below::kMap, "Keys of `provenance`"}}},
      {"Keys of a camera in calibration.yaml",
       {{"parameters", Below::kFree},
        {"sigma", Below::kFree},
        {"sigma_jackknife", Below::kFree},
        {"nuisances", Below::kFree},
        {"residuals", Below::kMap, "Keys of `residuals`"}}},
      {"Keys of `residuals`", {{"rms_by_type", Below::kFree}}},
      {"Keys of `verdict`", {{"findings", Below::kListOfMaps, "Keys of an item of `findings`"}}},
      {"Keys of an item of `undetermined`", {{"parameters", Below::kFree}}},
      {"Keys of try.yaml",
       {{"models", Below::kMapOfMaps, "Keys of a model in try.yaml"},
        {"stress", Below::kListOfMaps, "Keys of a stress test in try.yaml"},
        {"target", Below::kMap, "Keys of `target` in try.yaml"}}},
      {"Keys of `target` in try.yaml",
       {{"held", Below::kMap, "Keys of `held` and `refined`"},
        {"refined", Below::kMap, "Keys of `held` and `refined`"}}},
      {"Keys of `held` and `refined`", {{"held_out", Below::kMap, "Keys of `held_out`"}}},
      {"Keys of a model in try.yaml", {{"held_out", Below::kMap, "Keys of `held_out`"}}},
      {"Keys of check.json",
       {{"verdict", Below::kMap, "Keys of `verdict`"},
        {"cameras", Below::kListOfMaps, "Keys of a camera in check.json"}}},
      {"Keys of calibrate --json",
       {{"verdict", Below::kMap, "Keys of `verdict`"},
        {"cameras", Below::kMapOfMaps, "Keys of a camera in calibrate --json"}}},
      {"Keys of a camera in calibrate --json",
       {{"parameters", Below::kFree},
        {"sigma", Below::kFree},
        {"extrinsics", Below::kListOfMaps, "Keys of an item of `extrinsics`"}}},
      {"Keys of recording --json",
       {{"cameras", Below::kMapOfMaps, "Keys of a camera in recording --json"},
        {"topics", Below::kMapOfMaps, "Keys of a topic in recording --json"},
        {"pairs", Below::kMapOfMaps, "Keys of a camera in `pairs`"},
        {"left_out", Below::kListOfMaps, "Keys of an item of `left_out` in recording --json"},
        {"lacks", Below::kFree}}},
      {"Keys of a camera in recording --json",
       {{"gaps", Below::kListOfMaps, "Keys of an item of `gaps`"},
        {"exposure", Below::kMap, "Keys of `exposure`"}}},
      {"Keys of evaluate --json",
       {{"ate", Below::kMap, "Keys of `ate` and `rpe`"},
        {"rpe", Below::kMap, "Keys of `ate` and `rpe`"},
        {"runs", Below::kMapOfMaps, "Keys of evaluate --json"}}},
      {"Keys of `ate` and `rpe`",
       {{"unaligned", Below::kMap, "Keys of a statistics map"},
        {"se3", Below::kMap, "Keys of a statistics map"},
        {"sim3", Below::kMap, "Keys of a statistics map"},
        {"rotation_deg", Below::kMap, "Keys of a statistics map"}}}};
  return kChildren;
}

bool HasMaps(const YAML::Node& node) {
  if (node.IsMap()) return true;
  return node.IsSequence() &&
         std::any_of(node.begin(), node.end(), [](const auto& element) { return element.IsMap(); });
}

class FormatsPage : public Workspace {
 protected:
  const Names& NamesOf(const std::string& heading) {
    EXPECT_TRUE(page_.contains(heading)) << "docs/formats.md has no section '" << heading << "'";
    return page_[heading];
  }

  // --- what readers accept ---

  /// The names that the program lists because it does not know one in a file.
  static Names KnownNames(const Outcome& outcome) {
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    static const std::string kKnown = "; known: ";
    const size_t begin = outcome.err.find(kKnown);
    EXPECT_NE(begin, std::string::npos) << outcome.err;
    Names known;
    if (begin == std::string::npos) return known;
    std::istringstream list(outcome.err.substr(begin + kKnown.size()));
    for (std::string name; std::getline(list >> std::ws, name, ',');) {
      name.erase(name.find_last_not_of(" \n") + 1);
      known.insert(name);
    }
    return known;
  }

  /// The program, given a file with an unknown key, lists exactly the keys of these sections.
  void ExpectKnownKeys(const std::vector<std::string>& arguments,
                       const std::vector<std::string>& headings) {
    Names documented;
    for (const std::string& heading : headings) {
      documented.insert(NamesOf(heading).begin(), NamesOf(heading).end());
    }
    EXPECT_EQ(KnownNames(Run(arguments)), documented) << headings.front();
  }

  [[nodiscard]] Names TypesOfThePage() const {
    static const std::string kHeading = "Keys of type `";
    Names types;
    for (const auto& [heading, names] : page_) {
      if (!heading.starts_with(kHeading)) continue;
      types.insert(heading.substr(kHeading.size(), heading.size() - kHeading.size() - 1));
    }
    return types;
  }

  void ExpectSessionKeys(const std::string& text, const std::string& heading) {
    Write("session.yaml", text);
    ExpectKnownKeys({"calibrate", "session.yaml", "-o", "out"}, {heading});
  }

  void ExpectTargetKeys(const std::string& text, const std::vector<std::string>& headings) {
    Write("target.yaml", text);
    ExpectKnownKeys({"target", "target.yaml", "-o", "target.svg"}, headings);
  }

  void ExpectSpecificationKeys(const std::string& text, const std::string& heading) {
    Write("spec.yaml", text);
    ExpectKnownKeys({"simulate", "spec.yaml", "-o", "set"}, {heading});
  }

  /// The same of a map that `file` may stand in for.
  void ExpectKeysBesideFile(const std::string& text, const std::string& heading) {
    Write("spec.yaml", text);
    Names documented = NamesOf(heading);
    EXPECT_EQ(documented.erase("file"), 1U);
    EXPECT_EQ(KnownNames(Run({"simulate", "spec.yaml", "-o", "set"})), documented) << heading;
  }

  // --- what writers write ---

  void See(const std::string& heading, const std::string& name, const std::string& where) {
    EXPECT_TRUE(NamesOf(heading).contains(name))
        << where << ": docs/formats.md, '" << heading << "' lacks '" << name << "'";
    seen_[heading].insert(name);
  }

  /// Every key of a written map, and of the maps below it.
  void SeeKeys(const YAML::Node& map, const std::string& heading, const std::string& where) {
    NamesOf(heading);
    seen_[heading];
    for (const auto& entry : map) {
      const auto key = entry.first.as<std::string>();
      See(heading, key, where);
      if (!HasMaps(entry.second)) continue;
      const auto children = Children().find(heading);
      ASSERT_NE(children, Children().end()) << where << ": no section for the map " << key;
      const auto child = std::ranges::find(children->second, key, &Child::key);
      ASSERT_NE(child, children->second.end()) << where << ": no section for the map " << key;
      if (child->below == Below::kMap) SeeKeys(entry.second, child->heading, where);
      if (child->below == Below::kMapOfMaps) {
        for (const auto& each : entry.second) SeeKeys(each.second, child->heading, where);
      }
      if (child->below == Below::kListOfMaps) {
        for (const auto& each : entry.second) SeeKeys(each, child->heading, where);
      }
    }
  }

  void SeeYaml(const std::string& file, const std::string& heading) {
    SeeKeys(YAML::Load(Read(file)), heading, file);
  }

  /// Columns, after `general` has put NAME or N in place of what is chosen or counted.
  void SeeColumns(
      const std::string& file,
      const std::string& heading,
      const std::function<std::string(std::string)>& general = [](const std::string& name) {
        return name;
      }) {
    std::istringstream header(Lines(Read(file)).at(0));
    for (std::string name; std::getline(header, name, ',');) See(heading, general(name), file);
  }

  void SeeCalibration(const std::string& folder) {
    SeeYaml(folder + "/calibration.yaml", "Keys of calibration.yaml");
    for (const std::string& name : Results(folder)) {
      const std::string file = fmt::format("{}/{}", folder, name);
      if (name == "poses.csv") SeeColumns(file, "Columns of poses.csv");
      if (name == "view_poses.csv") SeeColumns(file, "Columns of view_poses.csv");
      if (name == "residuals.csv") SeeColumns(file, "Columns of residuals.csv");
      if (name == "left_out.csv") SeeColumns(file, "Columns of left_out.csv");
      if (name.starts_with("detections_")) {
        SeeColumns(file, "Columns of detections", [](const std::string& column) {
          return std::regex_replace(column, std::regex("_shared_[0-9]+"), "_shared_<n>");
        });
      }
      if (name == "correlations.csv") {
        SeeColumns(file, "Columns of correlations.csv", [](const std::string& column) {
          return column.find('.') == std::string::npos ? column : "<camera>.<name>";
        });
      }
      if (name.starts_with("micro_lenses_")) {
        SeeColumns(file, "Columns of `micro_lenses_<camera>.csv`");
      }
      if (name.starts_with("lattice_")) SeeYaml(file, "Keys of `lattice_<camera>.yaml`");
      if (name == "frames.csv") {
        SeeColumns(file, "Columns of frames.csv", [](const std::string& column) {
          return column.starts_with("markers_") ? "markers_<camera>" : column;
        });
      }
    }
  }

  void CalibrateAndSee(const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{
        "calibrate", "session.yaml", "-o", "out", "--no-report", "--fresh"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    SeeCalibration("out");
    fs::remove_all(Path("out"));
  }

  /// What a command makes of a calibration, in folder out.
  void SeeCalibrationOf(std::vector<std::string> arguments) {
    fs::remove_all(Path("out"));
    arguments.insert(arguments.end(), {"-o", "out"});
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    SeeCalibration("out");
  }

  /// A plenoptic camera given by detections: without sigmas and of several lens types, then with
  /// sigmas, depths of the templates and errors that all rows share.
  void SeePlenopticCalibrations() {
    for (const bool state_sigmas : {false, true}) {
      PlenopticProblem problem = MakePlenopticProblem(5,
                                                      {.corner = true,
                                                       .noise = 0.1,
                                                       .noise_of_type = {1, 1.6, 2.4},
                                                       .state_sigmas = state_sigmas,
                                                       .frames = 8,
                                                       .common_noise = 0.15,
                                                       .shared_slope = state_sigmas ? 0.001 : 0});
      CameraInput& camera = problem.input.cameras[0];
      for (View& view : camera.views) {
        // A depth that displaces nothing.
        for (Observation& seen : view.observations) seen.values[4] = state_sigmas ? 3 : 0;
      }
      std::string target = "plenocal: 1\ntype: markers\nmarkers:\n";
      for (const auto& [number, p] : problem.input.markers) {
        target += fmt::format("  {}: [{}, {}, {}]\n", number, p.x(), p.y(), p.z());
      }
      Write("target.yaml", target);
      Write("cam.csv", DetectionsCsv(camera.views, *camera.model));
      Write(
          "session.yaml",
          fmt::format("plenocal: 1\ntarget: target.yaml\ncameras: {{cam: {{model: {}, detections: "
                      "cam.csv, image_size: [{}, {}], pixel_size: {}}}}}\n",
                      camera.model->name,
                      camera.image_size[0],
                      camera.image_size[1],
                      camera.config[0]));
      CalibrateAndSee();
    }
  }

  /// Everything that the page has in the sections that were seen at all was written.
  void ExpectAllSeen(const Names& not_here = {}) {
    for (const auto& [heading, names] : seen_) {
      for (const std::string& name : page_[heading]) {
        if (not_here.contains(name)) continue;
        EXPECT_TRUE(names.contains(name))
            << "docs/formats.md, '" << heading << "': nothing here writes '" << name << "'";
      }
    }
  }

 private:
  std::map<std::string, Names> page_ = ReadPage();
  std::map<std::string, Names> seen_;
};

TEST_F(FormatsPage, HasTheKeysOfSessions) {
  const std::string head = "plenocal: 1\ntarget: target.yaml\n";
  const std::string camera = "model: focused-plenoptic, images: '*.png', pixel_size: 5e-6";
  ExpectSessionKeys(head + "qqqq: 1\n", "Keys of session.yaml");
  ExpectSessionKeys(head + fmt::format("cameras: {{a: {{{}, qqqq: 1}}}}\n", camera),
                    "Keys of a camera in a session");
  ExpectSessionKeys(
      head + fmt::format("cameras: {{a: {{{}, prior: {{f_L: {{qqqq: 1}}}}}}}}\n", camera),
      "Keys of a `prior`");
  ExpectSessionKeys(head + fmt::format("cameras: {{a: {{{}}}}}\noptions: {{qqqq: 1}}\n", camera),
                    "Keys of `options`");
  ExpectSessionKeys(head + fmt::format("cameras: {{a: {{{}}}}}\nexclude: [{{qqqq: 1}}]\n", camera),
                    "Keys of a rule in `exclude`");
  const std::string scene = fmt::format("plenocal: 1\ncameras: {{a: {{{}}}}}\n", camera);
  ExpectSessionKeys(scene + "scene: {qqqq: 1}\n", "Keys of `scene` in a session");
  ExpectSessionKeys(scene + "scene: {tags: {ids: [1], family: tag36h11, qqqq: 1}}\n",
                    "Keys of `tags` of a scene");
  ExpectSessionKeys(scene + "scene: {distances: [{qqqq: 1}]}\n",
                    "Keys of a distance in `distances`");
}

TEST_F(FormatsPage, HasTheKeysOfFormulas) {
  const auto expect = [&](const std::string& text, const std::string& heading) {
    Write("mine.model.yaml", "models: {mine: " + text + "}\n");
    ExpectKnownKeys({"--model-file", "mine.model.yaml", "models"}, {heading});
  };
  expect("{qqqq: 1}", "Keys of a formula in `models`");
  expect("{radius: theta, params: {k: {qqqq: 1}}}", "Keys of a parameter in `params`");
}

TEST_F(FormatsPage, HasTheKeysOfTargets) {
  for (const char* type : {"chessboard", "charuco", "circles", "aprilgrid", "apriltag"}) {
    ExpectTargetKeys(fmt::format("plenocal: 1\ntype: {}\nqqqq: 1\n", type),
                     {"Keys of every target", fmt::format("Keys of type `{}`", type)});
  }
  ExpectTargetKeys("plenocal: 1\ntype: markers\nqqqq: 1\n", {"Keys of every target"});
  ExpectTargetKeys("plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntags: [{qqqq: 1}]\n",
                   {"Keys of a tag in `tags`"});
  // The program has the types that the page has.
  Write("target.yaml", "plenocal: 1\ntype: qqqq\n");
  EXPECT_EQ(KnownNames(Run({"target", "target.yaml", "-o", "target.svg"})), TypesOfThePage());
}

TEST_F(FormatsPage, HasTheKeysOfKalibrTargets) {
  int checked = 0;
  for (const std::string& line : Lines(FileText(fs::path(PLENOCAL_DOCS) / "formats.md"))) {
    for (const char* type : {"aprilgrid", "checkerboard", "circlegrid"}) {
      const std::string first_cell = fmt::format("| `{}` |", type);
      if (!line.starts_with(first_cell)) continue;
      Names documented = NamesInFirstCell(line.substr(first_cell.size() - 1));
      documented.insert({"target_type", "tolerance", "scale_sigma", "markers", "sigma"});
      Write("target.yaml", fmt::format("target_type: {}\nqqqq: 1\n", type));
      EXPECT_EQ(KnownNames(Run({"target", "target.yaml", "-o", "target.svg"})), documented);
      ++checked;
    }
  }
  EXPECT_EQ(checked, 3);
}

TEST_F(FormatsPage, HasTheKeysOfRecordings) {
  const auto expect = [&](const std::string& text, const std::string& heading) {
    Write("recording.yaml", text);
    ExpectKnownKeys({"recording", "recording.yaml"}, {heading});
  };
  const std::string cameras = "plenocal: 1\ncameras: {a: {images: a}}\n";
  expect("plenocal: 1\nqqqq: 1\n", "Keys of recording.yaml");
  expect("plenocal: 1\ncameras: {a: {qqqq: 1}}\n", "Keys of a camera in recording.yaml");
  expect(cameras + "pairing: {qqqq: 1}\n", "Keys of `pairing`");
  expect(cameras + "markers: {a: {qqqq: 1}}\n", "Keys of a camera in `markers`");
}

TEST_F(FormatsPage, HasWhatRecordingWrites) {
  constexpr std::array kExposures{1, 2, 0, 1, 3};
  std::string times;
  for (const char* camera : {"left", "right"}) {
    fs::create_directories(Path(camera));
    for (size_t i = 0; i < kExposures.size(); ++i) {
      const int rows = i == 2 ? 8 : 16;  // one is of another size, so that there is a gap
      ASSERT_TRUE(cv::imwrite(Path(fmt::format("{}/{}.png", camera, i)).string(),
                              cv::Mat(rows, 16, CV_8U, cv::Scalar(100))));
    }
  }
  for (size_t i = 0; i < kExposures.size(); ++i) {
    times += fmt::format("{} {} {}\n", i, i, kExposures[i]);
  }
  Write("times.txt", times);
  Write("recording.yaml",
        "plenocal: 1\ncameras: {left: {images: left, times: times.txt, bayer: RGGB}, right: "
        "{images: right, times: times.txt}}\n");
  const Outcome outcome = Run({"recording", "recording.yaml", "--json"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  SeeKeys(YAML::Load(outcome.out), "Keys of recording --json", "recording --json");
  const fs::path messages = fs::path(PLENOCAL_TEST_DATA) / "recordings/plain.mcap";
  const Outcome of_messages = Run({"recording", messages.string(), "--json"});
  ASSERT_EQ(of_messages.status, kDone) << of_messages.err;
  SeeKeys(YAML::Load(of_messages.out), "Keys of recording --json", "recording --json");
  ExpectAllSeen();
}

TEST_F(FormatsPage, HasTheKeysOfPlans) {
  const auto expect = [&](const std::string& text, const std::string& heading) {
    Write("plan.yaml", text);
    ExpectKnownKeys({"fleet", "plan.yaml", "-o", "results"}, {heading});
  };
  expect("plenocal: 1\nqqqq: 1\n", "Keys of plan.yaml");
  expect("plenocal: 1\nrigs: {a: {qqqq: 1}}\n", "Keys of a rig in plan.yaml");
}

TEST_F(FormatsPage, HasTheKeysOfSpecifications) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.03\n");
  const std::string head = "plenocal: 1\ntarget: target.yaml\n";
  const std::string camera =
      "model: focused-plenoptic, image_size: [200, 200], pixel_size: 7.4e-6, parameters: {f_L: "
      "0.0122, b_L0: 0.01166, B: 0.00026, c_x: 100, c_y: 100}";
  const std::string lenses = "micro_lenses: {pitch: 19, focus: [3], qqqq: 1}";
  const std::string simple =
      "model: pinhole, image_size: [200, 200], parameters: {f_x: 200, f_y: "
      "200, c_x: 100, c_y: 100}";
  ExpectSpecificationKeys(head + "qqqq: 1\n", "Keys of a specification");
  ExpectSpecificationKeys(head + fmt::format("cameras: {{a: {{{}, qqqq: 1}}}}\n", camera),
                          "Keys of a camera in a specification");
  ExpectSpecificationKeys(head + fmt::format("cameras: {{a: {{{}, {}}}}}\n", camera, lenses),
                          "Keys of `micro_lenses`");
  const std::string scene = fmt::format("plenocal: 1\ncameras: {{a: {{{}}}}}\n", simple);
  ExpectSpecificationKeys(scene + "trajectory: {}\nscene: {qqqq: 1}\n", "Keys of `scene`");
  ExpectSpecificationKeys(scene + "trajectory: {winding: {qqqq: 1}}\nscene: {}\n",
                          "Keys of `winding`");
  ExpectSpecificationKeys(scene + "trajectory: {}\nscene: {}\ncalibration_sigma: {qqqq: 1}\n",
                          "Keys of `calibration_sigma`");
  ExpectSpecificationKeys(head + fmt::format("cameras: {{a: {{{}}}}}\nwall: {{qqqq: 1}}\n", simple),
                          "Keys of `wall`");
  ExpectSpecificationKeys(
      head + fmt::format("cameras: {{a: {{{}}}}}\nexposures: {{qqqq: 1}}\n", simple),
      "Keys of `exposures`");
  ExpectSpecificationKeys(
      head +
          fmt::format("cameras: {{a: {{{}}}}}\nexposures: {{range: [1, 2], late: {{qqqq: 1}}}}\n",
                      simple),
      "Keys of `late`");
  ExpectSpecificationKeys(
      head + fmt::format("cameras: {{a: {{{}, vignetting: {{qqqq: 1}}}}}}\n", simple),
      "Keys of `vignetting`");
  // `file` stands alone, so that the reader does not name it among the others.
  ExpectKeysBesideFile(scene + "trajectory: {qqqq: 1}\nscene: {}\n", "Keys of `trajectory`");
  ExpectKeysBesideFile(head + fmt::format("cameras: {{a: {{{}}}}}\nposes: {{qqqq: 1}}\n", simple),
                       "Keys of `poses`");
}

// Sessions that make the program write each key at least once.
TEST_F(FormatsPage, HasWhatCalibrationsWrite) {
  // A rig that is not synchronous, with a jackknife.
  WriteProblem(MakeProblem(7,
                           {.cameras = 2,
                            .frames = 12,
                            .noise = 0.1,
                            .jitter_translation = 0.002,
                            .jitter_rotation = 0.005}));
  CalibrateAndSee({"--jackknife"});

  // Cameras whose clocks differ.
  Write("board.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.03\n");
  const std::string camera =
      "{model: pinhole-radial3, image_size: [640, 480], parameters: {f_x: 500, f_y: 500, c_x: 320, "
      "c_y: 240, A_0: 0, A_1: 0, A_2: 0}";
  Write(
      "moving.yaml",
      fmt::format("plenocal: 1\ntarget: board.yaml\ncameras:\n  a: {0}}}\n  b: {0}, xi_camera_rig: "
                  "[-0.1, 0, 0, 0, 0, 0], time_shift: 0.005}}\n"
                  "poses: {{kind: moving, frames: 60, distance: [0.4, 0.8]}}\n",
                  camera));
  ASSERT_EQ(Run({"simulate", "moving.yaml", "--points", "-o", "."}).status, kDone);
  CalibrateAndSee();

  // A print of another size.
  WriteProblem(EasyProblem());
  Write("target.yaml", Read("target.yaml") + "scale_sigma: 0.005\n");
  CalibrateAndSee();

  // An estimate at its bound.
  WriteProblem(EasyProblem());
  Write("session.yaml",
        Replaced(Read("session.yaml"), "    model:", "    bounds: {A_0: [0.5, 0.6]}\n    model:"));
  CalibrateAndSee();

  // A second target of known pose, which no frame shows.
  WriteProblem(EasyProblem());
  Write(
      "session.yaml",
      Replaced(Read("session.yaml"),
               "target: target.yaml",
               "targets: {a: target.yaml, b: {target: target.yaml, pose: [[1, 0, 0, 1], [0, 1, 0, "
               "0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"));
  CalibrateAndSee();

  // Frames from one pose leave parameters open.
  SyntheticProblem still = EasyProblem();
  for (View& view : still.input.cameras[0].views) {
    view.observations = still.input.cameras[0].views[0].observations;
  }
  WriteProblem(still);
  CalibrateAndSee();

  // Images, of which one is kept as a sample.
  for (int i = 0; i < kImages; ++i) {
    fs::create_directories(Path("images"));
    ASSERT_TRUE(cv::imwrite(Path(fmt::format("images/{:02}.png", i)).string(), ChessboardView(i)));
  }
  Write("target.yaml",
        fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n",
                    kColumns,
                    kRows,
                    kSquare));
  Write("session.yaml",
        "plenocal: 1\ntarget: target.yaml\ncameras: {cam: {model: pinhole-radial3, images: "
        "images/*.png}}\n");
  CalibrateAndSee();
  SeePlenopticCalibrations();

  // What a simulation writes of the truth; what other commands make of a calibration.
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.01\n");
  Write("spec.yaml",
        "plenocal: 1\ntarget: target.yaml\nwhite_images: 1\ncameras:\n"
        "  left: {model: pinhole+pupil, image_size: [240, 200], parameters: {f_x: 200, f_y: 200, "
        "c_x: 120, c_y: 100, e_0: 0.001, e_1: 0, e_2: 0}}\n"
        "  plenoptic: {model: focused-plenoptic, image_size: [240, 240], pixel_size: 7.4e-6, "
        "parameters: {f_L: 0.0122, b_L0: 0.01166, B: 0.00026, c_x: 120, c_y: 120}, micro_lenses: "
        "{pitch: 19, focus: [3]}}\nposes: {frames: 1, distance: [0.4, 0.4]}\n");
  ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set"}).status, kDone);
  SeeCalibration("set/truth");
  SeeCalibrationOf(
      {"convert", "set/truth/calibration.yaml", "--camera", "left", "--to", "pinhole"});
  SeeColumns("out/conversion_errors.csv", "Columns of conversion_errors.csv");
  Write("mine.model.yaml", "models: {mine: {radius: theta}}\n");
  SeeCalibrationOf({"--model-file",
                    "mine.model.yaml",
                    "convert",
                    "set/truth/calibration.yaml",
                    "--camera",
                    "left",
                    "--to",
                    "mine"});
  SeeCalibrationOf({"map", "set/truth/calibration.yaml", "--camera", "left", "--distance", "0.4"});
  WriteProblem(EasyProblem(2));
  ASSERT_EQ(Run({"calibrate", "session.yaml", "-o", "rig", "--no-report"}).status, kDone);
  SeeCalibrationOf({"rectify", "rig/calibration.yaml"});
  // These need a calibration from images of a fisheye or a plenoptic camera, which takes long.
  ExpectAllSeen({"image_circle", "lattice", "sample_depth", "lens_types"});
}

TEST_F(FormatsPage, HasWhatJudgingCommandsWrite) {
  WriteProblem(EasyProblem(2, 0.0005));
  const Outcome result = Run({"calibrate", "session.yaml", "-o", "out", "--no-report", "--json"});
  ASSERT_EQ(result.status, kDone) << result.err;
  SeeKeys(YAML::Load(result.out), "Keys of calibrate --json", "calibrate --json");
  EXPECT_THAT(
      CalibrationSchema(PLENOCAL_DOCS).Violations(nlohmann::json::parse(result.out), "Calibration"),
      ::testing::IsEmpty());
  const Outcome check = Run(
      {"compare", "out/calibration.yaml", "--check", "session.yaml", "--json", "-o", "compared"});
  ASSERT_EQ(check.status, kDone) << check.err;
  SeeKeys(YAML::Load(check.out), "Keys of check.json", "compare --check --json");
  SeeYaml("compared/check.json", "Keys of check.json");
  SeeColumns("compared/compare.csv", "Columns of compare.csv");

  // One of these models fails.
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 14\nrows: 10\nsquare: 0.03\n");
  const std::string spec =
      "plenocal: 1\nseed: 3\ntarget: target.yaml\ncameras:\n  cam: {model: kannala-brandt4, "
      "image_size: [640, 480], parameters: {f_x: 183, f_y: 183, c_x: 320, c_y: 240}, "
      "detection_sigma: 0.05}\nposes: {distance: [0.18, 0.45], partial: 0.3, frames: ";
  Write("spec.yaml", spec + "20}\n");
  Write("few.yaml", spec + "6}\n");
  ASSERT_EQ(Run({"simulate", "spec.yaml", "--points", "-o", "set"}).status, kDone);
  const auto try_models = [&](const std::string& models) {
    const Outcome tried =
        Run({"try", "set/session.yaml", "--models", models, "--stress", "-o", "tried"});
    ASSERT_EQ(tried.status, kDone) << tried.err;
    SeeYaml("tried/try.yaml", "Keys of try.yaml");
  };
  try_models("pinhole-radtan4,kannala-brandt4");
  SeeColumns("tried/try.csv", "Columns of try.csv");
  // So few frames that there is no stress test.
  ASSERT_EQ(Run({"simulate", "few.yaml", "--points", "-o", "set"}).status, kDone);
  try_models("kannala-brandt4");
  ExpectAllSeen({"target_scale"});  // of a session with scale_sigma (result_test.cc)
}

TEST_F(FormatsPage, HasTheTablesOfTheSchemaOfCalibrations) {
  const std::string page = FileText(fs::path(PLENOCAL_DOCS) / "formats.md");
  int tables = 0;
  const CalibrationSchema schema(PLENOCAL_DOCS);
  for (const CalibrationSchema::Json& definition : schema.Definitions()) {
    if (!definition.contains("title")) continue;
    std::string table = fmt::format("### {}\n\n| key | meaning |\n| --- | --- |\n",
                                    definition.at("title").get<std::string>());
    for (const auto& [key, property] : definition.at("properties").items()) {
      table += fmt::format("| `{}` | {} |\n", key, property.at("description").get<std::string>());
    }
    EXPECT_THAT(page, HasSubstr(table + "\n")) << "take the table from here";
    ++tables;
  }
  EXPECT_EQ(tables, 6);
}

TEST_F(FormatsPage, HasWhatWhiteAndFocusWrite) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.01\n");
  Write("spec.yaml",
        "plenocal: 1\ntarget: target.yaml\nwhite_images: 1\ncameras:\n  cam: {model: "
        "focused-plenoptic, image_size: [240, 240], pixel_size: 7.4e-6, parameters: {f_L: 0.0122, "
        "b_L0: 0.01166, B: 0.00026, c_x: 120, c_y: 120}, micro_lenses: {pitch: 19, focus: "
        "[3]}}\nposes: {frames: 1, distance: [0.4, 0.4]}\n");
  ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set"}).status, kDone);
  const Outcome white = Run({"white", "set/session.yaml", "-o", "white"});
  ASSERT_EQ(white.status, kDone) << white.err;
  SeeColumns("white/micro_lenses_cam.csv", "Columns of `micro_lenses_<camera>.csv`");
  SeeYaml("white/lattice_cam.yaml", "Keys of `lattice_<camera>.yaml`");
  const Outcome focus = Run({"focus", "set/cam", "--white", "set/cam_white", "-o", "focused"});
  ASSERT_EQ(focus.status, kDone) << focus.err;
  SeeYaml("focused/focused.yaml", "Keys of focused.yaml");
  ExpectAllSeen();

  const std::string page = FileText(fs::path(PLENOCAL_DOCS) / "formats.md");
  for (const char* folder : {"white", "focused"}) {
    for (const std::string& name : Results(folder)) {
      EXPECT_THAT(page, HasSubstr(std::regex_replace(name, std::regex("_cam[.]"), "_<camera>.")));
    }
  }
}

TEST_F(FormatsPage, HasWhatResponseAndComparisonsOfAttenuationsWrite) {
  Write("target.yaml", "plenocal: 1\ntype: chessboard\ncolumns: 8\nrows: 5\nsquare: 0.03\n");
  Write("spec.yaml",
        "plenocal: 1\ntarget: target.yaml\nwall: {}\nexposures: {range: [0.1, 20], nominal: 5, "
        "order: sweep}\nwhite_images: 1\nposes: {kind: still, frames: 20, distance: [1, 1]}\n"
        "cameras: {cam: {model: pinhole, image_size: [160, 120], parameters: {f_x: 100, f_y: 100, "
        "c_x: 80, c_y: 60}}}\n");
  ASSERT_EQ(Run({"simulate", "spec.yaml", "-o", "set"}).status, kDone);
  const Outcome response = Run({"response", "set/recording.yaml", "-o", "response"});
  ASSERT_EQ(response.status, kDone) << response.err;
  SeeColumns("response/response.csv", "Columns of response.csv");
  const std::string attenuation = "set/truth/vignetting_cam.tiff";
  const Outcome compared = Run({"compare", attenuation, attenuation, "-o", "compared"});
  ASSERT_EQ(compared.status, kDone) << compared.err;
  SeeColumns("compared/vignetting_compare.csv", "Columns of vignetting_compare.csv");
  ExpectAllSeen();
}

TEST_F(FormatsPage, HasWhatComparisonsOfGroundTruthsWrite) {
  Write("loop.yaml", SmallLoopYaml({}));
  ASSERT_EQ(Run({"simulate", "loop.yaml", "--points", "-o", "loop"}).status, kDone);
  ASSERT_EQ(Run({"groundtruth", "loop", "-o", "truth"}).status, kDone);
  const std::string truth = "truth/groundtruth.yaml";
  ASSERT_EQ(Run({"compare", truth, truth, "-o", "compared"}).status, kDone);
  SeeColumns("compared/groundtruth_compare.csv", "Columns of groundtruth_compare.csv");
  ExpectAllSeen();
}

TEST_F(FormatsPage, HasWhatEvaluateWrites) {
  constexpr int kPoses = 100, kSegment = 20;
  std::string estimate, truth;
  for (int i = 0; i < kPoses; ++i) {
    const double angle = 2 * std::numbers::pi * i / kPoses;
    const std::string pose = fmt::format(
        "{} {} {} {} 0 0 0 1\n", i, std::cos(angle), std::sin(angle), 0.1 * std::sin(3 * angle));
    estimate += pose;
    if (i < kSegment || i >= kPoses - kSegment) truth += pose;
  }
  Write("estimate.txt", estimate);
  Write("truth.txt", truth);
  Write("short.txt", estimate.substr(0, estimate.find('\n') + 1));
  const auto see = [&](const std::vector<std::string>& estimates) {
    std::vector<std::string> arguments{"evaluate", "--truth", "truth.txt", "--json", "--estimate"};
    arguments.insert(arguments.end(), estimates.begin(), estimates.end());
    const Outcome outcome = Run(arguments);
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    SeeKeys(YAML::Load(outcome.out), "Keys of evaluate --json", "evaluate --json");
  };
  see({"estimate.txt"});
  see({"GOOD=estimate.txt", "SHORT=short.txt"});
  ExpectAllSeen({"errors_by_truth"});  // of a groundtruth.yaml (scene/)
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
