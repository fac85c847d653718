// SPDX-License-Identifier: Apache-2.0
//
// Sessions from images on the command line, and from memory.
#include "engine/session/image_session.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "engine/session/memory_session.h"
#include "engine/session/open_session.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr const char* kBoard = "chessboard:9x6:25mm";

class ImageSessions : public InTemporaryFolder {
 protected:
  ImageSessions() {
    for (const char* file : {"l/a1.png", "l/a2.png", "r/b1.png", "r/b2.png", "one/x.png"})
      Write(file, "");
  }
  [[nodiscard]] ImageSession Make(const ImageArguments& arguments) {
    plenocal::Run run;
    run.listener.message = [&](const std::string& line) { messages_.push_back(line); };
    return {arguments, Path("out"), run};
  }
  /// "name: images" of each camera.
  std::vector<std::string> CamerasOf(const ImageArguments& arguments) {
    std::vector<std::string> shown;
    for (const SessionCamera& camera : Make(arguments).With("pinhole", "").cameras) {
      std::string& text = shown.emplace_back(camera.name + ":");
      for (const std::string& images : camera.images) text += " " + images;
    }
    return shown;
  }
  std::string Refusal(const ImageArguments& arguments) {
    return RefusalOf([&] { static_cast<void>(Make(arguments)); });
  }
  [[nodiscard]] std::string In(const std::string& name) const { return Path(name).string(); }

  std::vector<std::string> messages_;
};

TEST_F(ImageSessions, HaveOneCameraOrAPair) {
  EXPECT_THAT(CamerasOf({.images = {In("l")}, .right = {}, .cameras = {}, .target = kBoard}),
              ElementsAre("cam: " + In("l")));
  EXPECT_THAT(messages_, IsEmpty());
  EXPECT_THAT(CamerasOf({.images = {In("l/a1.png"), In("l/a2.png")},
                         .right = {},
                         .cameras = {},
                         .target = kBoard}),
              ElementsAre("cam: " + In("l/a*.png")));
  // The frames get names that both share.
  EXPECT_THAT(CamerasOf({.images = {In("l")}, .right = {In("r")}, .cameras = {}, .target = kBoard}),
              ElementsAre("left: " + In("l/a*.png"), "right: " + In("r/b*.png")));
  EXPECT_THAT(CamerasOf({.images = {},
                         .right = {},
                         .cameras = {"n=" + In("l/a*.png"), "w=" + In("r/b*.png")},
                         .target = kBoard}),
              ElementsAre("n: " + In("l/a*.png"), "w: " + In("r/b*.png")));
}

TEST_F(ImageSessions, HaveTheCamerasOfAFolder) {
  for (const char* file :
       {"both/left1.png", "both/left2.png", "both/right1.png", "both/right2.png"})
    Write(file, "");
  EXPECT_THAT(CamerasOf({.images = {In("both")}, .right = {}, .cameras = {}, .target = kBoard}),
              ElementsAre("left: " + In("both/left*.png"), "right: " + In("both/right*.png")));
  EXPECT_THAT(messages_,
              ElementsAre("camera left: " + In("both/left*.png"),
                          "camera right: " + In("both/right*.png")));
}

TEST_F(ImageSessions, RefuseArgumentsThatDoNotFit) {
  const std::string both =
      "--camera: names all cameras; give their images by --camera NAME=GLOB alone";
  EXPECT_EQ(Refusal({.images = {In("l")}, .right = {}, .cameras = {"a=b"}, .target = kBoard}),
            both);
  EXPECT_EQ(Refusal({.images = {}, .right = {In("r")}, .cameras = {"a=b"}, .target = kBoard}),
            both);
  for (const std::string camera : {"left", "=x", "left="}) {
    EXPECT_EQ(Refusal({.images = {}, .right = {}, .cameras = {camera}, .target = kBoard}),
              "--camera " + camera + ": expected NAME=GLOB");
  }
  EXPECT_EQ(Refusal({.images = {In("none")}, .right = {}, .cameras = {}, .target = kBoard}),
            In("none") + ": no such file or folder; check the path");
  EXPECT_THAT(
      Refusal({.images = {In("l/a1.png")},
               .right = {In("one/x.png")},
               .cameras = {},
               .target = kBoard}),
      HasSubstr("the cameras' images have no frame in common (left has 'a1', right has 'x')"));
}

TEST_F(ImageSessions, ReplaceTheirOwnSessionAlone) {
  const ImageArguments arguments{.images = {In("l")}, .right = {}, .cameras = {}, .target = kBoard};
  const std::string text = Make(arguments).With("pinhole", "").text;
  Write("out/session.yaml", text);
  EXPECT_EQ(Refusal(arguments), "no refusal");
  Write("out/session.yaml", "# mine\n" + text);
  EXPECT_EQ(Refusal(arguments),
            In("out/session.yaml") +
                ": was not written from images on the command line and would be "
                "replaced; give another folder with -o");
}

TEST_F(ImageSessions, AreWrittenAsTheyWillBeRead) {
  const ImageSession made =
      Make({.images = {In("l")}, .right = {In("r")}, .cameras = {}, .target = kBoard});
  EXPECT_EQ(made.target().markers.size(), 54U);
  EXPECT_EQ(made.target_text(),
            "plenocal: 1\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 25mm\n");
  const Session session = made.With("kannala-brandt4", "false");
  EXPECT_EQ(session.path, Path("out/session.yaml"));
  EXPECT_EQ(session.text,
            "# Written by 'plenocal calibrate' from images; the next run with images replaces it.\n"
            "# Copy it before you change it. All keys: docs/formats.md\n"
            "plenocal: 1\n"
            "target: nominal_target.yaml\n"
            "cameras:  # the first is the rig's master\n"
            "  left:\n    model: kannala-brandt4\n    images: ../l/a*.png\n"
            "  right:\n    model: kannala-brandt4\n    images: ../r/b*.png\n"
            "options:\n  refine_target: false\n");
  EXPECT_EQ(session.refine_target, false);
  EXPECT_EQ(session.cameras[1].model->name, "kannala-brandt4");
  EXPECT_THAT(session.cameras[0].images, ElementsAre(In("l/a*.png")));
  EXPECT_TRUE(session.target.keys);
  const Session one =
      Make({.images = {In("l")}, .right = {}, .cameras = {}, .target = kBoard}).With("pinhole", "");
  EXPECT_THAT(one.text, EndsWith("cameras:\n  cam:\n    model: pinhole\n    images: ../l/\n"));
  EXPECT_FALSE(one.refine_target);
}

// ---- sessions in memory

class MemorySessions : public ::testing::Test {
 protected:
  static std::string ImageRefusal(const PixelView& view) {
    return RefusalOf([&] { ImagesInMemory("left", {{"f1", view}}); });
  }
  const std::vector<std::uint8_t> bytes_ = [] {
    std::vector<std::uint8_t> bytes(100);
    for (size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i);
    return bytes;
  }();
  PixelView View(ImageSize size, int channels, int bytes_per_value, size_t stride) const {
    PixelView view;
    view.data = bytes_.data();
    view.size = size;
    view.channels = channels;
    view.bytes_per_value = bytes_per_value;
    view.stride = stride;
    return view;
  }
};

TEST_F(MemorySessions, HaveImagesWithoutTheGapsOfTheirRows) {
  struct Case {
    int channels, bytes;
    const char* encoding;
  };
  for (const auto& [channels, bytes, encoding] :
       {Case{1, 1, "mono8"}, {3, 1, "bgr8"}, {1, 2, "mono16"}, {3, 2, "bgr16"}}) {
    const size_t row = 2U * static_cast<size_t>(channels * bytes);
    const auto images = ImagesInMemory("left",
                                       {{"f1", View({2, 3}, channels, bytes, row + 5)},
                                        {"f2", View({2, 3}, channels, bytes, row)}});
    ASSERT_EQ(images.size(), 2U);
    EXPECT_EQ(images[0].frame, "f1");
    EXPECT_EQ(images[0].path, "left: frame f1");
    const ImageStore& store = *images[0].store;
    EXPECT_FALSE(store.HasFiles());
    for (const size_t gap : {5U, 0U}) {
      const StoredImage image = store.Read(gap == 5 ? 0 : images[1].index);
      EXPECT_EQ(image.encoding, encoding);
      EXPECT_EQ(image.size, (ImageSize{2, 3}));
      EXPECT_EQ(image.step, row);
      ASSERT_EQ(image.bytes.size(), 3 * row);
      for (size_t i = 0; i < image.bytes.size(); ++i) {
        EXPECT_EQ(image.bytes[i], i / row * (row + gap) + i % row);
      }
    }
    EXPECT_EQ(store.Start(0, 1).bytes.size(), 3 * row);
    EXPECT_NE(store.Hash(0), store.Hash(1));
  }
  // The same bytes of another form are another image.
  const auto forms = ImagesInMemory(
      "left",
      {{"a", View({6, 1}, 1, 1, 6)}, {"b", View({2, 1}, 3, 1, 6)}, {"c", View({3, 2}, 1, 1, 3)}});
  EXPECT_NE(forms[0].store->Hash(0), forms[0].store->Hash(1));
  EXPECT_NE(forms[0].store->Hash(0), forms[0].store->Hash(2));
}

TEST_F(MemorySessions, RefuseImagesThatAreNone) {
  const std::string at = "left: frame f1: ";
  PixelView empty = View({2, 3}, 1, 1, 2);
  empty.data = nullptr;
  EXPECT_EQ(ImageRefusal(empty), at + "a view of memory without pixels");
  EXPECT_EQ(ImageRefusal(View({0, 3}, 1, 1, 2)), at + "expected a positive size, found 0 x 3");
  EXPECT_EQ(ImageRefusal(View({2, 0}, 1, 1, 2)), at + "expected a positive size, found 2 x 0");
  EXPECT_EQ(ImageRefusal(View({2, 3}, 2, 1, 9)), at + "expected 1 or 3 channels, found 2");
  EXPECT_EQ(ImageRefusal(View({2, 3}, 4, 1, 9)), at + "expected 1 or 3 channels, found 4");
  EXPECT_EQ(ImageRefusal(View({2, 3}, 1, 3, 9)), at + "expected 1 or 2 bytes per value, found 3");
  EXPECT_EQ(ImageRefusal(View({2, 3}, 1, 0, 9)), at + "expected 1 or 2 bytes per value, found 0");
  EXPECT_EQ(ImageRefusal(View({2, 3}, 3, 2, 11)),
            at + "the stride of 11 bytes is shorter than a row of 12");
  EXPECT_EQ(
      RefusalOf([&] {
        ImagesInMemory("left", {{"f1", View({2, 3}, 1, 1, 2)}, {"f1", View({2, 3}, 1, 1, 2)}});
      }),
      "left: frame f1 is given twice");
}

TEST_F(MemorySessions, HaveTheirCameras) {
  MemoryCamera points;
  points.name = "points";
  points.model = FindModel(CameraModels(), "pinhole");
  points.image_size = {640, 480};
  points.views = {{"f1", {}}};
  MemoryCamera images;
  images.name = "images";
  images.images = {{"f1", View({2, 3}, 1, 1, 2)}};
  const Session session = SessionInMemory(kBoard, {points, images});
  ASSERT_EQ(session.cameras.size(), 2U);
  EXPECT_EQ(session.cameras[0].model->name, "pinhole");
  EXPECT_FALSE(session.cameras[0].auto_model);
  EXPECT_EQ(session.cameras[0].given_views.size(), 1U);
  EXPECT_EQ(session.cameras[0].image_size, (ImageSize{640, 480}));
  EXPECT_EQ(session.cameras[1].model->name, "pinhole-radtan");
  EXPECT_TRUE(session.cameras[1].auto_model);
  EXPECT_EQ(session.cameras[1].initial.size(), session.cameras[1].model->params.size());
  EXPECT_EQ(session.cameras[1].fixed.size(), session.cameras[1].model->params.size());
  EXPECT_EQ(session.cameras[1].given_images.size(), 1U);
  EXPECT_TRUE(session.auto_refine);
  EXPECT_FALSE(SessionInMemory(kBoard, {points}).auto_refine);
  const auto refusal = [&](const std::vector<MemoryCamera>& cameras) {
    return RefusalOf([&] { SessionInMemory(kBoard, cameras); });
  };
  EXPECT_EQ(refusal({}), "no camera is given");
  EXPECT_EQ(refusal({points, points}), "camera points is given twice");
  MemoryCamera other = points;
  other.images = images.images;
  EXPECT_EQ(refusal({other}), "camera points: give either images or points");
  other.images.clear();
  other.views.clear();
  EXPECT_EQ(refusal({other}), "camera points: give either images or points");
  other = points;
  other.name = "a/b";
  EXPECT_THAT(refusal({other}), ::testing::StartsWith("camera a/b: the name "));
}

TEST_F(ImageSessions, AreKnownByTheOnlyArgument) {
  EXPECT_TRUE(NamesSession({"a.yaml"}));
  EXPECT_TRUE(NamesSession({"a.yml"}));
  EXPECT_FALSE(NamesSession({"a.yaml", "b.yaml"}));
  EXPECT_FALSE(NamesSession({}));
  EXPECT_FALSE(NamesSession({In("l")}));
  EXPECT_FALSE(NamesSession({In("l/a1.png")}));
  EXPECT_FALSE(NamesSession({In("none.txt")}));
  EXPECT_TRUE(NamesSession({Write("session.txt", "").string()}));
  EXPECT_FALSE(NamesSession({Write("a.mcap", "").string()}));
  EXPECT_EQ(ModelNamed("--model", "pinhole")->name, "pinhole");
  EXPECT_THAT(RefusalOf([] { ModelNamed("--model", "pinhol"); }),
              ::testing::StartsWith("--model pinhol: unknown camera model; did you mean 'pinhole"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
