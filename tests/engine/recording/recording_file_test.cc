// SPDX-License-Identifier: Apache-2.0
//
// Keys of recording.yaml, with the lines and keys of refusals.
#include "engine/recording/recording_file.h"

#include <gmock/gmock.h>

#include <regex>

#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

class RecordingFiles : public InTemporaryFolder {
 protected:
  RecordingFiles() {
    for (const char* file : {"t.txt", "m.txt", "c.yaml", "p.txt", "v.png", "w/1.png", "tracks.csv"})
      Write(file, "");
  }
  [[nodiscard]] RecordingFile Read(const std::string& text) const {
    return ReadRecordingFile(Write("recording.yaml", "plenocal: 1\n" + text));
  }
  /// The only camera, by its keys.
  [[nodiscard]] RecordedFiles Camera(const std::string& keys) const {
    return Read("cameras: {left: {" + keys + "}}\n").cameras.at(0);
  }
  /// The refusal without the file's path and the column.
  [[nodiscard]] std::string Refusal(const std::string& text) const {
    const std::string message = RefusalOf([&] { static_cast<void>(Read(text)); });
    const std::string start = In("recording.yaml") + ":";
    if (!message.starts_with(start)) return message;
    return std::regex_replace(message.substr(start.size()), std::regex("^([0-9]+):[0-9]+:"), "$1:");
  }
  [[nodiscard]] std::string CameraRefusal(const std::string& keys) const {
    return Refusal("cameras: {left: {" + keys + "}}\n");
  }
  [[nodiscard]] std::string MarkersRefusal(const std::string& keys) const {
    return Refusal("cameras: {left: {images: l}}\nmarkers: {left: {" + keys + "}}\n");
  }
  [[nodiscard]] std::string In(const std::string& name) const { return Path(name).string(); }
};

TEST_F(RecordingFiles, HaveCamerasInTheirOrder) {
  const RecordingFile file =
      Read("cameras:\n  right: {images: r/*.png}\n  left:\n    images: [l1, l2]\n");
  EXPECT_EQ(file.path, Path("recording.yaml"));
  EXPECT_EQ(file.layout, "recording.yaml");
  ASSERT_EQ(file.cameras.size(), 2U);
  const RecordedFiles &right = file.cameras[0], &left = file.cameras[1];
  EXPECT_EQ(right.name, "right");
  EXPECT_EQ(right.where, In("recording.yaml") + ":3: cameras.right.images");
  EXPECT_THAT(right.images, ElementsAre(In("r/*.png")));
  EXPECT_EQ(left.where, In("recording.yaml") + ":5: cameras.left.images");
  EXPECT_THAT(left.images, ElementsAre(In("l1"), In("l2")));
  EXPECT_EQ(left.times, "");
  EXPECT_EQ(left.tracks, "");
  EXPECT_EQ(left.exposure_unit, ExposureUnit::kMilliseconds);
  EXPECT_THAT(left.white_images, IsEmpty());
  EXPECT_FALSE(left.bayer || left.pixel_size || left.markers);
  for (const auto& path :
       {left.vignetting, left.response, file.calibration, file.truth, file.exposures})
    EXPECT_EQ(path, "");
  EXPECT_FALSE(file.pairing.by);
}

TEST_F(RecordingFiles, HaveKeysOfACamera) {
  const RecordedFiles camera = Camera(
      "images: a.zip, topic: /left, times: t.txt, exposure_unit: s, white_images: [w, x/*.png], "
      "bayer: GBRG, pixel_size: 5um");
  EXPECT_THAT(camera.images, ElementsAre(In("a.zip/left")));
  EXPECT_EQ(camera.times, Path("t.txt"));
  EXPECT_EQ(camera.exposure_unit, ExposureUnit::kSeconds);
  EXPECT_THAT(camera.white_images, ElementsAre(In("w"), In("x/*.png")));
  EXPECT_EQ(camera.bayer, BayerOrder::kGbrg);
  EXPECT_DOUBLE_EQ(*camera.pixel_size, 5e-6);
  EXPECT_EQ(Camera("images: l, exposure_unit: ms").exposure_unit, ExposureUnit::kMilliseconds);
  EXPECT_EQ(Camera("images: l, exposure_unit: us").exposure_unit, ExposureUnit::kMicroseconds);
}

TEST_F(RecordingFiles, HaveTracksInPlaceOfImages) {
  const RecordedFiles tracks = Camera("tracks: tracks.csv");
  EXPECT_EQ(tracks.tracks, Path("tracks.csv"));
  EXPECT_THAT(tracks.images, IsEmpty());
  EXPECT_EQ(tracks.where, In("recording.yaml") + ":2: cameras.left");
  const RecordedFiles both = Camera("images: l, tracks: tracks.csv");
  EXPECT_EQ(both.tracks, Path("tracks.csv"));
  EXPECT_THAT(both.images, ElementsAre(In("l")));
}

TEST_F(RecordingFiles, HaveFilesOfAllCamerasAndOfEach) {
  const RecordingFile file = Read(
      "cameras: {left: {images: l}, right: {images: r}}\npairing: {by: name}\n"
      "calibration: c.yaml\ntruth: t.txt\nexposures: m.txt\nresponse: {right: p.txt}\n"
      "vignetting: {right: v.png}\n");
  EXPECT_EQ(file.pairing.by, Pairing::By::kName);
  EXPECT_EQ(file.calibration, Path("c.yaml"));
  EXPECT_EQ(file.truth, Path("t.txt"));
  EXPECT_EQ(file.exposures, Path("m.txt"));
  EXPECT_EQ(file.cameras[0].response, "");
  EXPECT_EQ(file.cameras[0].vignetting, "");
  EXPECT_EQ(file.cameras[1].response, Path("p.txt"));
  EXPECT_EQ(file.cameras[1].vignetting, Path("v.png"));
}

TEST_F(RecordingFiles, HaveMarkersInColumns) {
  const auto markers = [&](const std::string& more) {
    return *Read(
                "cameras: {left: {images: l}}\nmarkers: {left: {file: m.txt, columns: "
                "[marker, frame, x, y, odd]" +
                more + "}}\n")
                .cameras[0]
                .markers;
  };
  const MarkerFile file = markers("");
  EXPECT_EQ(file.path, Path("m.txt"));
  EXPECT_THAT(file.columns, ElementsAre("marker", "frame", "x", "y", "odd"));
  EXPECT_EQ(file.pixel_origin, 0);
  EXPECT_EQ(file.skip, 0);
  for (const double origin : {0.0, 0.5, 1.0}) {
    EXPECT_EQ(markers(", pixel_origin: " + std::to_string(origin)).pixel_origin, origin);
  }
  EXPECT_EQ(markers(", skip: 0").skip, 0);
  EXPECT_EQ(markers(", skip: 3").skip, 3);
}

TEST_F(RecordingFiles, WithWrongMarkersAreRefused) {
  const std::string columns = "columns: [frame, marker, x, y]";
  EXPECT_THAT(MarkersRefusal("file: m.txt, " + columns + ", origin: 1"),
              StartsWith("3: markers.left.origin: unknown key"));
  EXPECT_EQ(MarkersRefusal(columns),
            "3: markers.left.file: this key is missing; add, for example, 'file: markers.txt'");
  EXPECT_EQ(MarkersRefusal("file: m.txt"),
            "3: markers.left.columns: this key is missing; add, for example, 'columns: [frame, "
            "marker, x, y]'");
  EXPECT_EQ(MarkersRefusal("file: none.txt, " + columns),
            "3: markers.left.file: " + In("none.txt") +
                ": no such file; paths are relative to this file");
  EXPECT_EQ(MarkersRefusal("file: m.txt, columns: [frame, marker, x, x, y]"),
            "3: markers.left.columns[3]: 'x' stands here twice; give each column a name of its "
            "own");
  for (const char* name : {"frame", "marker", "x", "y"}) {
    std::string others;
    for (const std::string other : {"frame", "marker", "x", "y"}) {
      others += other == name ? "" : other + ", ";
    }
    EXPECT_EQ(MarkersRefusal("file: m.txt, columns: [" + others + "sigma]"),
              "3: markers.left.columns: '" + std::string(name) +
                  "' is missing; name all columns of the file, such as [frame, marker, x, y, "
                  "sigma]");
  }
  for (const char* origin : {"-0.5", "0.4", "2"}) {
    EXPECT_EQ(MarkersRefusal("file: m.txt, " + columns + ", pixel_origin: " + origin),
              "3: markers.left.pixel_origin: expected the coordinate of the centre of the top-left "
              "pixel: 0, 0.5 or 1 (MATLAB)");
  }
  EXPECT_EQ(MarkersRefusal("file: m.txt, " + columns + ", skip: -1"),
            "3: markers.left.skip: expected a number of lines, 0 or more");
}

TEST_F(RecordingFiles, WithWrongCamerasAreRefused) {
  EXPECT_EQ(Refusal("cameras: {}\n"), "2: cameras: expected at least one camera");
  EXPECT_THAT(Refusal("truth: t.txt\n"), HasSubstr("cameras: {left: {images: left/*.png}}"));
  EXPECT_THAT(Refusal("cameras: {left: {images: l}}\ntruths: t.txt\n"),
              StartsWith("3: truths: unknown key; did you mean 'truth'?"));
  EXPECT_THAT(Refusal("cameras: {a b: {images: l}}\n"), HasSubstr("2: cameras.a b: "));
  EXPECT_THAT(CameraRefusal("image: l"), HasSubstr("did you mean 'images'?"));
  EXPECT_THAT(CameraRefusal("times: t.txt"), HasSubstr("images: left/*.png"));
  EXPECT_EQ(CameraRefusal("images: l, exposure_unit: mss"),
            "2: cameras.left.exposure_unit: unknown 'mss'; did you mean 'ms'?");
  EXPECT_THAT(CameraRefusal("images: l, pixel_size: -1"), StartsWith("2: cameras.left.pixel_size"));
  for (const char* key : {"times", "tracks"}) {
    EXPECT_EQ(CameraRefusal(std::string("images: l, ") + key + ": none.txt"),
              std::string("2: cameras.left.") + key + ": " + In("none.txt") +
                  ": no such file; paths are relative to this file");
  }
  EXPECT_THAT(RefusalOf([&] {
                static_cast<void>(
                    ReadRecordingFile(Write("v.yaml", "plenocal: 2\ncameras: {l: {images: l}}\n")));
              }),
              HasSubstr("v.yaml:1:11: plenocal: expected format version 1"));
}

TEST_F(RecordingFiles, WithWrongFilesOfCamerasAreRefused) {
  const std::string cameras = "cameras: {left: {images: l}}\n";
  for (const std::string key : {"calibration", "truth", "exposures"}) {
    EXPECT_EQ(
        Refusal(cameras + key + ": none.txt\n"),
        "3: " + key + ": " + In("none.txt") + ": no such file; paths are relative to this file");
  }
  for (const std::string key : {"response", "vignetting", "markers"}) {
    EXPECT_EQ(Refusal(cameras + key + ": {lift: v.png}\n"),
              "3: " + key + ".lift: no camera is called so; did you mean 'left'?");
  }
  for (const std::string key : {"response", "vignetting"}) {
    EXPECT_EQ(Refusal(cameras + key + ": {left: none.txt}\n"),
              "3: " + key + ".left: " + In("none.txt") +
                  ": no such file; paths are relative to this file");
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
