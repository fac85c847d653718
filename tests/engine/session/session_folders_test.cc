// SPDX-License-Identifier: Apache-2.0
//
// The folder that a run writes, read back; its cache of detections; how a session is opened.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include "calib/io/own_file.h"
#include "engine/session/calibration_folder.h"
#include "engine/session/open_session.h"
#include "engine/session/run_folders.h"
#include "engine/session/run_provenance.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

// ---- results read back

class CalibrationFolders : public InTemporaryFolder {
 protected:
  void WriteCalibration(const std::string& more = "", const std::string& camera = Pinhole()) const {
    Write("out/calibration.yaml", "plenocal: 1\ncameras:\n" + camera + more);
  }
  static std::string Pinhole() {
    return CameraText("pinhole", "f_x: 500, f_y: 501, c_x: 320, c_y: 240");
  }
  static std::string Axial() {
    return CameraText("equidistant+pupil",
                      "f_x: 500, f_y: 501, c_x: 320, c_y: 240, e_0: 0.001, e_1: 0, e_2: 0");
  }
  static std::string CameraText(const std::string& model, const std::string& params) {
    return fmt::format(
        "  left:\n    model: {}\n    image_size: [640, 480]\n    parameters: {{{}}}\n"
        "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n",
        model,
        params);
  }
  void WriteTables() const {
    Write("out/target.yaml",
          "plenocal: 1\ntype: markers\nmarkers: {1: [0, 0, 0], 7: [0.1, 0.2, 0.3]}\n"
          "sigma: {7: [1e-5, 2e-5, 3e-5]}\n");
    Write("out/poses.csv", "frame,x,y,z,qx,qy,qz,qw\nf1,1,2,3,0,0,0,1\nf2,4,5,6,0,0,0,1\n");
    Write("out/residuals.csv",
          "camera,frame,marker,x,y,dx,dy,used,noise_sigma\nleft,f2,7,10,20,0.1,0.2,1,0.3\n");
  }
  CalibrationRecord Open() const { return OpenCalibrationFolder(Path("out")); }
  [[nodiscard]] std::string In(const std::string& name) const { return Path(name).string(); }
};

TEST_F(CalibrationFolders, HaveAllTables) {
  WriteCalibration();
  WriteTables();
  CalibrationRecord record = Open();
  EXPECT_EQ(record.path, Path("out/calibration.yaml"));
  ASSERT_EQ(record.markers.size(), 2U);
  EXPECT_EQ(record.markers.at(7).position, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(*record.markers.at(7).sigma, Eigen::Vector3d(1e-5, 2e-5, 3e-5));
  EXPECT_FALSE(record.markers.at(1).sigma);
  ASSERT_EQ(record.frames.size(), 2U);
  EXPECT_EQ(record.frames[1].name, "f2");
  EXPECT_EQ(record.frames[1].T_target_rig.t, Eigen::Vector3d(4, 5, 6));
  ASSERT_EQ(record.cameras[0].residuals.size(), 1U);
  EXPECT_EQ(record.cameras[0].residuals[0].marker, 7);
  EXPECT_THAT(record.cameras[0].view_poses, IsEmpty());
  EXPECT_THAT(record.correlations.names, IsEmpty());
  Write("out/view_poses.csv",
        "camera,frame,x,y,z,qx,qy,qz,qw,misplaced\nleft,f2,7,8,9,0,0,0,1,0\n");
  Write("out/correlations.csv", "unknown,left.f_x,left.f_y\nleft.f_x,1,0.5\nleft.f_y,0.5,1\n");
  record = Open();
  EXPECT_EQ(record.cameras[0].view_poses.at(1).T_target_rig.t, Eigen::Vector3d(7, 8, 9));
  EXPECT_EQ(record.correlations.matrix(0, 1), 0.5);
  EXPECT_EQ(OpenWithCorrelations(Path("out/calibration.yaml")).correlations.names.size(), 2U);
  EXPECT_THAT(OpenCalibration(Path("out/calibration.yaml")).correlations.names, IsEmpty());
}

TEST_F(CalibrationFolders, OfScenesHavePointsForATarget) {
  WriteCalibration(
      "adjustment: {converged: true, iterations: 3, rejection_sigmas: 4, marker_sigma: .inf}\n");
  WriteTables();
  Write("out/points.csv", "marker,x,y,z\n7,1,2,3\n9,4,5,6\n");
  const CalibrationRecord record = Open();
  ASSERT_EQ(record.markers.size(), 2U);
  EXPECT_EQ(record.markers.at(9).position, Eigen::Vector3d(4, 5, 6));
  EXPECT_FALSE(record.markers.at(7).nominal || record.markers.at(7).sigma);
  fs::remove(Path("out/points.csv"));
  EXPECT_THAT(RefusalOf([&] { Open(); }), StartsWith(In("out/points.csv") + ": no such file"));
}

TEST_F(CalibrationFolders, WithoutATableAreRefused) {
  EXPECT_EQ(
      RefusalOf([&] { Open(); }),
      In("out") + ": no folder that can be read; give the one that 'plenocal calibrate' wrote");
  for (const char* name : {"calibration.yaml", "target.yaml", "poses.csv", "residuals.csv"}) {
    WriteCalibration();
    WriteTables();
    fs::remove(Path("out") / name);
    EXPECT_EQ(
        RefusalOf([&] { Open(); }),
        In("out/") + name + ": no such file; is this the folder that 'plenocal calibrate' wrote?");
  }
  EXPECT_EQ(RefusalOf([&] { OpenCalibrationFolder(Path("out/target.yaml")); }),
            In("out/target.yaml") +
                ": no folder that can be read; give the one that 'plenocal calibrate' wrote");
}

TEST_F(CalibrationFolders, GiveViewsWhereACameraHasNoSingleCentre) {
  const auto open = [&] { return OpenForViews(Path("out/calibration.yaml")); };
  WriteCalibration();
  WriteTables();
  EXPECT_THAT(open().markers, IsEmpty());
  EXPECT_THAT(open().frames, IsEmpty());
  WriteCalibration("", Axial());
  EXPECT_EQ(open().markers.size(), 2U);
  EXPECT_EQ(open().frames.size(), 2U);
  for (const char* name : {"out/poses.csv", "out/target.yaml"}) {
    WriteTables();
    fs::remove(Path(name));
    EXPECT_THAT(open().markers, IsEmpty());
    EXPECT_THAT(open().frames, IsEmpty());
  }
}

TEST_F(CalibrationFolders, AreNamedByOptionOrRecording) {
  EXPECT_EQ(CalibrationOf("r.yaml", "named.yaml", "given.yaml"), "given.yaml");
  EXPECT_EQ(CalibrationOf("r.yaml", "named.yaml", ""), "named.yaml");
  EXPECT_EQ(RefusalOf([] { static_cast<void>(CalibrationOf("r.yaml", "", "")); }),
            "r.yaml: names no calibration; give --calibration calibration.yaml");
}

TEST_F(CalibrationFolders, HaveTheNominalPlacesOfATarget) {
  CalibrationRecord record;
  record.markers[0] = {.position = {1, 1, 1}};
  record.markers[50] = {.position = {2, 2, 2}, .nominal = Eigen::Vector3d(3, 3, 3)};
  AddTarget(TargetOfWord("chessboard:2x2:30mm"), &record);
  ASSERT_EQ(record.markers.size(), 5U);
  EXPECT_EQ(record.markers.at(0).position, Eigen::Vector3d(1, 1, 1));
  EXPECT_EQ(record.markers.at(50).nominal, Eigen::Vector3d(3, 3, 3));
  const Target board = TargetOfWord("chessboard:2x2:30mm");
  for (const auto& [number, position] : board.markers) {
    EXPECT_EQ(record.markers.at(number).nominal, position) << number;
    if (number > 0) {
      EXPECT_EQ(record.markers.at(number).position, position) << number;
    }
  }
  // A marker that the nominal target lacks has none.
  Target more = board;
  more.markers[1] = {9, 9, 9};
  more.markers[77] = {7, 7, 7};
  record.markers[77].nominal = Eigen::Vector3d(0, 0, 0);
  AddTarget(more, &record);
  EXPECT_FALSE(record.markers.at(77).nominal);
  EXPECT_EQ(record.markers.at(1).nominal, board.markers.at(1));
}

TEST_F(CalibrationFolders, HaveFilesThatCamerasName) {
  CalibrationRecord record;
  record.cameras.resize(2);
  record.cameras[0].micro_lenses = "m.csv";
  record.cameras[0].vignetting = "v.tiff";
  record.cameras[1].sample = "s.jpg";
  record.cameras[1].sample_depth = "d.png";
  for (const char* name : {"m.csv", "v.tiff", "s.jpg", "d.png", "other"}) {
    Write(std::string("out/") + name, std::string("of ") + name);
  }
  CameraFiles files = ReadCameraFiles(Path("out"), record);
  EXPECT_EQ(files.Path("m.csv"), In("out/m.csv"));
  EXPECT_EQ(files.contents.size(), 4U);
  for (const char* name : {"m.csv", "v.tiff", "s.jpg", "d.png"}) {
    ASSERT_NE(files.Find(name), nullptr) << name;
    EXPECT_EQ(*files.Find(name), std::string("of ") + name);
  }
  EXPECT_EQ(files.Find("other"), nullptr);
  files.contents[""] = "none";
  EXPECT_EQ(files.Find(""), nullptr);
  record.cameras[1].sample = "none.jpg";
  fs::remove(Path("out/d.png"));
  fs::create_directories(Path("out/d.png"));
  EXPECT_EQ(ReadCameraFiles(Path("out"), record).contents.size(), 2U);
}

// ---- folders of a run

class RunsFolders : public InTemporaryFolder {
 protected:
  RunsFolders() {
    session_.path = Path("session.yaml");
    session_.target.keys = YamlNode::Parse("chessboard:4x3:30mm", "target");
    session_.cameras.resize(2);
    session_.cameras[1].images = {"left"};
  }
  [[nodiscard]] SessionOptions Into(const char* out,
                                    const char* cache = "",
                                    bool fresh = false) const {
    SessionOptions options;
    if (*out != 0) options.out = Path(out);
    if (*cache != 0) options.cache = Path(cache);
    options.fresh = fresh;
    return options;
  }
  RunFolders Folders(const SessionOptions& options) {
    return {options, session_, {"calibration.yaml"}};
  }
  [[nodiscard]] bool Exists(const std::string& name) const { return fs::exists(Path(name)); }
  /// Whether an entry of one cache is found in another.
  static bool Finds(DetectionCache* from, DetectionCache* in) {
    from->Save(from->Key({"a"}), "content");
    return in->Load(in->Key({"a"})).has_value();
  }
  Session session_;
};

TEST_F(RunsFolders, KeepDetectionsOfTheSameProgramAndTarget) {
  const auto open = [&](const Session& session, EarlierDetections earlier) {
    return OpenDetectionCache(Path("out"), session, earlier);
  };
  using enum EarlierDetections;
  DetectionCache first = open(session_, kReuse);
  EXPECT_FALSE(Exists("out/.cache"));
  DetectionCache again = open(session_, kReuse);
  EXPECT_TRUE(Finds(&first, &again));
  EXPECT_TRUE(Exists("out/.cache"));
  DetectionCache fresh = open(session_, kIgnore);
  EXPECT_FALSE(Finds(&first, &fresh));
  DetectionCache own(Path("out/.cache"),
                     fmt::format("plenocal {} {} {}",
                                 ProvenanceOf("", session_, "")[0].second,
                                 HashFile(OwnFile()),
                                 session_.target.Text()),
                     false);
  EXPECT_TRUE(Finds(&first, &own));
  Session other = session_;
  other.target.keys = YamlNode::Parse("chessboard:4x3:31mm", "target");
  DetectionCache of_other = open(other, kReuse);
  EXPECT_FALSE(Finds(&first, &of_other));
  // Without images it is none of theirs, and without a folder nothing is kept.
  other = session_;
  other.cameras[1].images.clear();
  DetectionCache of_points = open(other, kReuse);
  EXPECT_FALSE(Finds(&first, &of_points));
  DetectionCache nowhere = OpenDetectionCache("", session_, kReuse);
  EXPECT_FALSE(Finds(&nowhere, &nowhere));
}

TEST_F(RunsFolders, AreWrittenByCommit) {
  {
    RunFolders folders = Folders(Into("out"));
    folders.out()->Write("calibration.yaml", "made");
    EXPECT_TRUE(Finds(folders.cache(), folders.cache()));
  }
  EXPECT_FALSE(Exists("out/calibration.yaml"));
  RunFolders folders = Folders(Into("out"));
  folders.out()->Write("calibration.yaml", "made");
  folders.Commit();
  EXPECT_EQ(files_.Read("out/calibration.yaml"), "made");
}

TEST_F(RunsFolders, RemoveWhatTheirCacheDidNotUse) {
  const auto entries = [&](const std::string& folder) {
    size_t count = 0;
    if (!Exists(folder)) return count;
    for (const auto& entry : fs::recursive_directory_iterator(Path(folder))) {
      count += entry.is_regular_file() ? 1 : 0;
    }
    return count;
  };
  const auto commit = [&](const SessionOptions& options, const char* use) {
    RunFolders folders = Folders(options);
    DetectionCache* const cache = folders.cache();
    cache->Save(cache->Key({use}), "content");
    folders.Commit();
  };
  commit(Into("out"), "a");
  EXPECT_EQ(entries("out/.cache"), 1U);
  commit(Into("out"), "b");
  EXPECT_EQ(entries("out/.cache"), 1U);
  // That of another folder may serve other runs.
  for (const char* use : {"a", "b"}) commit(Into("out", "common"), use);
  EXPECT_EQ(entries("common/.cache"), 2U);
  EXPECT_EQ(entries("out/.cache"), 1U);
  // Without results nothing leaves it.
  commit(Into("", "common"), "c");
  EXPECT_EQ(entries("common/.cache"), 3U);
}

TEST_F(RunsFolders, IgnoreEarlierDetectionsOnDemand) {
  const auto finds = [&](bool fresh) {
    RunFolders folders = Folders(Into("out", "", fresh));
    DetectionCache* const cache = folders.cache();
    const bool found = cache->Load(cache->Key({"a"})).has_value();
    cache->Save(cache->Key({"a"}), "content");
    folders.Commit();
    return found;
  };
  EXPECT_FALSE(finds(false));
  EXPECT_TRUE(finds(false));
  EXPECT_FALSE(finds(true));
}

TEST_F(RunsFolders, MayBeNoneAndReplaceNoInput) {
  EXPECT_EQ(Folders({}).out(), nullptr);
  Folders({}).Commit();
  fs::create_directories(Path("out/calibration.yaml"));
  EXPECT_THAT(RefusalOf([&] { Folders(Into("out")); }, ErrorKind::kJob),
              HasSubstr("calibration.yaml"));
}

TEST_F(RunsFolders, TellWhatMadeThem) {
  session_.text = "the session";
  session_.target.file = "t.yaml";
  session_.target.keys = {};
  Write("t.yaml", "the target");
  session_.target.file = Path("t.yaml");
  const auto provenance = ProvenanceOf("calibrate", session_, "out");
  std::vector<std::string> shown;
  for (const auto& [key, value] : provenance) shown.push_back(key + "=" + value);
  ASSERT_EQ(shown.size(), 7U);
  EXPECT_THAT(shown[0], ::testing::MatchesRegex("plenocal_version=[0-9].*"));
  shown.erase(shown.begin());
  EXPECT_THAT(shown,
              ElementsAre("command=calibrate " + session_.path.string() + " -o out",
                          "folder=" + fs::current_path().string(),
                          "session=" + session_.path.string(),
                          "target=" + Path("t.yaml").string(),
                          "session_text=the session",
                          "target_text=the target"));
}

// ---- sessions

TEST_F(RunsFolders, OfKilledRunsAreCompletedFirst) {
  // A run that was killed before its files were moved.
  const auto kill = [&](const std::string& folder, const std::string& file) {
    Write(folder + "/.partial/" + file, "done");
    Write(folder + "/.partial/complete", "");
  };
  Write(
      "s/session.yaml",
      "plenocal: 1\ntarget: ../t/target.yaml\nfrom: ../f/calibration.yaml\ncameras:\n"
      "  left: {model: pinhole, images: ../i/*.png, white_images: ../w, times: ../m/t.txt}\n"
      "  right: {model: pinhole, detections: ../d/r.csv, image_size: [640, 480], from: ../g/calibration.yaml}\n");
  for (const char* folder : {"s", "t", "f", "i", "w", "m", "d", "g"}) kill(folder, "new.txt");
  for (const char* file : {"f/calibration.yaml", "g/calibration.yaml"}) Write(file, "");
  const Session session = OpenSession(Path("s/session.yaml"));
  for (const char* folder : {"s", "t", "f", "i", "w", "m", "d", "g"}) {
    EXPECT_EQ(files_.Read(std::string(folder) + "/new.txt"), "done") << folder;
  }
  EXPECT_EQ(session.cameras[1].model->name, "pinhole");
  Write("n/session.yaml",
        "plenocal: 1\ntargets: {a: {target: ../k/target.yaml}, b: {target: ../l/target.yaml}}\n"
        "cameras:\n  left: {model: pinhole, images: ../i/*.png}\n");
  for (const char* folder : {"k", "l"}) kill(folder, "new.txt");
  OpenSession(Path("n/session.yaml"));
  for (const char* folder : {"k", "l"}) EXPECT_TRUE(Exists(std::string(folder) + "/new.txt"));
}

TEST(SessionModels, AreGivenWithoutInitialValues) {
  EXPECT_EQ(UsualModel().name, "pinhole-radtan");
  SessionCamera camera;
  camera.auto_model = true;
  camera.initial = {1.0};
  camera.fixed = {true};
  UseModel(*FindModel(CameraModels(), "pinhole"), &camera);
  EXPECT_EQ(camera.model->name, "pinhole");
  EXPECT_FALSE(camera.auto_model);
  EXPECT_EQ(camera.initial, std::vector<std::optional<double>>(4));
  EXPECT_EQ(camera.fixed, std::vector<bool>(4, false));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
