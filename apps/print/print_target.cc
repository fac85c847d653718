// SPDX-License-Identifier: Apache-2.0
#include "apps/print/print_target.h"

#include <cairo/cairo-pdf.h>
#include <cairo/cairo-svg.h>
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>

#include "apps/charts/cairo_handles.h"
#include "apps/charts/cairo_path.h"
#include "apps/charts/picture.h"
#include "calib/base/format_error.h"
#include "calib/io/output_folder.h"
#include "targets/target.h"
#include "targets/target_drawing.h"

// All lengths here are in mm, positions from a page's upper left corner.

namespace plenocal {
namespace print {
namespace {

constexpr double kMillimetres = 1000;  // in a metre
constexpr double kInch = 25.4;
constexpr double kMargin = 10;  // that office printers leave white
constexpr double kFoot = 14;    // below the target: ruler and name
constexpr double kGap = 8;      // between tags on a page, with room for their labels
constexpr double kText = 3;     // height of letters

struct Paper {
  std::string_view name;
  double width, height;  // upright
};
constexpr std::array kPapers{Paper{"a0", 841, 1189},
                             Paper{"a1", 594, 841},
                             Paper{"a2", 420, 594},
                             Paper{"a3", 297, 420},
                             Paper{"a4", 210, 297},
                             Paper{"a5", 148, 210},
                             Paper{"letter", 215.9, 279.4},
                             Paper{"legal", 215.9, 355.6},
                             Paper{"tabloid", 279.4, 431.8}};

// A part of the target, or a window of one, on a page.
struct Placed {
  const TargetPart* part = nullptr;
  Eigen::Vector2d at{0, 0};     // where the upper left corner of the part's paper goes
  Eigen::AlignedBox2d visible;  // of the page
  std::string label;
  bool cut_marks = false;
  bool numbered = false;  // DrawNumbers
};

struct Page {
  double width = 0, height = 0;
  std::vector<Placed> placed;
  std::string name;  // in the foot
};

Eigen::Vector2d SizeOf(const TargetPart& part) { return kMillimetres * part.paper.sizes(); }

void Line(cairo_t* context, double x0, double y0, double x1, double y1) {
  cairo_move_to(context, x0, y0);
  cairo_line_to(context, x1, y1);
}

void Text(cairo_t* context, double x, double y, const std::string& text) {
  cairo_move_to(context, x, y);
  cairo_show_text(context, text.c_str());
}

// As long as the page allows, at most 200 mm.
void DrawRuler(cairo_t* context, const Page& page) {
  const double length = std::min(200.0, std::floor((page.width - 2 * kMargin) / 10) * 10);
  if (length < 10) return;
  const double y = page.height - kMargin - 2, x = kMargin;
  Line(context, x, y, x + length, y);
  for (int mm = 0; mm <= static_cast<int>(length); mm += 5) {
    Line(context, x + mm, y, x + mm, y - (mm % 50 == 0 ? 4 : mm % 10 == 0 ? 2.5 : 1.5));
  }
  cairo_stroke(context);
  Text(context,
       x,
       y + kText + 0.5,
       fmt::format("{:.0f} mm: print at 100 %, then measure this   {}", length, page.name));
}

// Text around `middle`, of letters `height` high, legible on black and on white.
void Mark(cairo_t* context, const Eigen::Vector2d& middle, double height, const std::string& text) {
  SetFont(context, height);
  cairo_text_extents_t extents;
  cairo_text_extents(context, text.c_str(), &extents);
  cairo_move_to(context,
                middle.x() - extents.x_bearing - extents.width / 2,
                middle.y() - extents.y_bearing - extents.height / 2);
  cairo_text_path(context, text.c_str());
  cairo_set_source_rgb(context, 1, 1, 1);
  cairo_set_line_width(context, height / 3);
  cairo_stroke_preserve(context);
  cairo_set_source_rgb(context, 0.75, 0.1, 0.05);
  cairo_fill(context);
}

// The numbers of markers and tags, and the target's axes x and y from its origin, in mm of `part`.
void DrawNumbers(cairo_t* context, const TargetPart& part) {
  const auto mark = [&](const Eigen::Vector2d& middle, double height, int number) {
    Mark(context, kMillimetres * middle, kMillimetres * height, std::to_string(number));
  };
  for (const DrawnTag& tag : part.tags) {
    const Eigen::Vector2d diagonal = tag.outline[2] - tag.outline[0];
    mark(tag.outline[0] + diagonal / 2, 0.25 * diagonal.norm(), tag.id);
  }
  for (const Disc& disc : part.black_discs) mark(disc.centre, disc.radius, disc.marker);
  if (part.squares) {
    const SquareGrid& grid = *part.squares;
    for (int i = 0; i < grid.columns * grid.rows; ++i) {
      const Eigen::Vector2d place(i % grid.columns, i / grid.columns);
      mark(grid.pitch * place + Eigen::Vector2d::Constant(grid.first), 0.25 * grid.pitch, i);
    }
  }
  const RigidTransform T_part_target = part.T_target_part.Inverse();
  const double out_of_plane =
      std::abs(T_part_target.t.z()) + T_part_target.R.col(2).head<2>().norm();
  if (out_of_plane > 1e-6) return;
  const Eigen::Vector2d origin = kMillimetres * T_part_target.t.head<2>();
  const double length = kMillimetres * part.paper.sizes().minCoeff() / 4, text = length / 5;
  for (const int axis : {0, 1}) {
    const Eigen::Vector2d along = T_part_target.R.col(axis).head<2>();
    const Eigen::Vector2d end = origin + length * along, across(-along.y(), along.x());
    cairo_set_source_rgb(context, 0.05, 0.3, 0.75);
    cairo_set_line_width(context, text / 6);
    Line(context, origin.x(), origin.y(), end.x(), end.y());
    for (const double side : {-0.5, 0.5}) {
      const Eigen::Vector2d barb = end + text * (side * across - along);
      Line(context, end.x(), end.y(), barb.x(), barb.y());
    }
    cairo_stroke(context);
    const Eigen::Vector2d other = T_part_target.R.col(1 - axis).head<2>();
    Mark(context, end - 0.9 * text * other, text, axis == 0 ? "x" : "y");
  }
}

void DrawPlaced(cairo_t* context, const Placed& placed) {
  const Eigen::AlignedBox2d& box = placed.visible;
  cairo_save(context);
  cairo_rectangle(context, box.min().x(), box.min().y(), box.sizes().x(), box.sizes().y());
  cairo_clip(context);
  const Eigen::Vector2d origin = placed.at - kMillimetres * placed.part->paper.min();
  cairo_translate(context, origin.x(), origin.y());
  cairo_save(context);
  cairo_scale(context, kMillimetres, kMillimetres);
  FillBlack(context, *placed.part);
  cairo_restore(context);
  if (placed.numbered) DrawNumbers(context, *placed.part);
  cairo_restore(context);
  if (placed.cut_marks) {
    constexpr double kAway = 0.5, kLength = 3;
    for (const double x : {box.min().x(), box.max().x()}) {
      Line(context, x, box.min().y() - kAway, x, box.min().y() - kLength);
      Line(context, x, box.max().y() + kAway, x, box.max().y() + kLength);
    }
    for (const double y : {box.min().y(), box.max().y()}) {
      Line(context, box.min().x() - kAway, y, box.min().x() - kLength, y);
      Line(context, box.max().x() + kAway, y, box.max().x() + kLength, y);
    }
    cairo_stroke(context);
  }
  Text(context, box.min().x() + 1, box.max().y() + kText + 1, placed.label);
}

void DrawPage(cairo_t* context, const Page& page) {
  cairo_set_source_rgb(context, 1, 1, 1);
  cairo_paint(context);
  cairo_set_source_rgb(context, 0, 0, 0);
  cairo_set_line_width(context, 0.15);
  SetFont(context, kText);
  for (const Placed& placed : page.placed) DrawPlaced(context, placed);
  DrawRuler(context, page);
}

// The paper, upright or across, whichever a sheet of that size fits on or needs fewer of.
Page EmptyPage(const Paper& paper, const Eigen::Vector2d& content) {
  const auto sheets = [&](double width, double height) {
    return std::ceil(content.x() / (width - 2 * kMargin)) *
           std::ceil(content.y() / (height - 2 * kMargin - kFoot));
  };
  const bool across = sheets(paper.height, paper.width) < sheets(paper.width, paper.height);
  return across ? Page{paper.height, paper.width, {}, {}} : Page{paper.width, paper.height, {}, {}};
}

// Far more pages than anybody joins: each draws the whole target.
constexpr int kMostPages = 400;

// A flat target, over as many pages as it needs.
std::vector<Page> LayOutSheet(const TargetPart& part, const std::optional<Paper>& paper) {
  const Eigen::Vector2d size = SizeOf(part);
  if (!paper) {
    // Room for a ruler of some use, however small the target.
    Page page{std::max(size.x(), 40.0) + 2 * kMargin, size.y() + 2 * kMargin + kFoot, {}, {}};
    const Eigen::Vector2d at(kMargin, kMargin);
    page.placed.push_back({&part, at, {at, Eigen::Vector2d(at + size)}, {}, false});
    return {page};
  }
  const Page empty = EmptyPage(*paper, size);
  const Eigen::Vector2d window(empty.width - 2 * kMargin, empty.height - 2 * kMargin - kFoot);
  const double across = std::ceil(size.x() / window.x() - 1e-9);
  const double down = std::ceil(size.y() / window.y() - 1e-9);
  if (!(across * down <= kMostPages)) {
    throw InputError(
        "{:.0f} x {:.0f} mm need {:.3g} pages of paper {}; at most {} can be "
        "joined: check the target's unit, take a larger --paper or 'fit'",
        size.x(),
        size.y(),
        across * down,
        paper->name,
        kMostPages);
  }
  const int columns = static_cast<int>(across), rows = static_cast<int>(down);
  std::vector<Page> pages;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      Page page = empty;
      const Eigen::Vector2d shown(column * window.x(), row * window.y());
      const Eigen::Vector2d rest = (size - shown).cwiseMin(window);
      const Eigen::Vector2d corner(kMargin, kMargin);
      const bool tiled = rows * columns > 1;
      page.placed.push_back(
          {&part, corner - shown, {corner, Eigen::Vector2d(corner + rest)}, {}, tiled});
      if (tiled) {
        page.name = fmt::format("row {} of {}, column {} of {}: cut at the marks and join",
                                row + 1,
                                rows,
                                column + 1,
                                columns);
      }
      pages.push_back(std::move(page));
    }
  }
  return pages;
}

// Tags one by one, in rows.
std::vector<Page> LayOutTags(const std::vector<TargetPart>& parts, const Paper& paper) {
  std::vector<Page> pages;
  double x = 0, y = 0, row_height = 0;
  for (const TargetPart& part : parts) {
    const Eigen::Vector2d size = SizeOf(part);
    const double right = paper.width - kMargin, bottom = paper.height - kMargin - kFoot;
    if (size.x() > right - kMargin || size.y() > bottom - kMargin) {
      throw InputError(
          "tag {} needs {:.0f} x {:.0f} mm, which paper {} does not have; take a "
          "larger --paper",
          part.tags[0].id,
          size.x(),
          size.y(),
          paper.name);
    }
    if (x + size.x() > right) x = kMargin, y += row_height + kGap, row_height = 0;
    if (pages.empty() || y + size.y() > bottom) {
      pages.push_back({paper.width, paper.height, {}, {}});
      x = y = kMargin;
      row_height = 0;
    }
    const Eigen::Vector2d at(x, y);
    const double side = kMillimetres * (part.tags[0].outline[1] - part.tags[0].outline[0]).norm();
    pages.back().placed.push_back({&part,
                                   at,
                                   {at, Eigen::Vector2d(at + size)},
                                   fmt::format("id {}, {:.1f} mm", part.tags[0].id, side),
                                   true});
    x += size.x() + kGap;
    row_height = std::max(row_height, size.y());
  }
  return pages;
}

// Draws pages onto a surface whose unit is `scale` times a mm.
void DrawPages(cairo_surface_t* surface, double scale, const std::vector<Page>& pages) {
  Check(cairo_surface_status(surface));
  const Context context(cairo_create(surface));
  cairo_scale(context.get(), scale, scale);
  for (const Page& page : pages) {
    DrawPage(context.get(), page);
    cairo_show_page(context.get());
  }
  Check(cairo_status(context.get()));
}

std::string Svg(const Page& page) {
  std::string text;
  {
    const Surface surface(
        cairo_svg_surface_create_for_stream(Append, &text, page.width, page.height));
    cairo_svg_surface_set_document_unit(surface.get(), CAIRO_SVG_UNIT_MM);
    DrawPages(surface.get(), 1, {page});
    cairo_surface_finish(surface.get());
    Check(cairo_surface_status(surface.get()));
  }
  return text;
}

std::string Pdf(const std::vector<Page>& pages) {
  constexpr double kPoints = 72 / kInch;
  std::string text;
  {
    const Surface surface(cairo_pdf_surface_create_for_stream(
        Append, &text, kPoints * pages[0].width, kPoints * pages[0].height));
    // Later versions compress the page's size, which other programs read.
    cairo_pdf_surface_restrict_to_version(surface.get(), CAIRO_PDF_VERSION_1_4);
    // cairo's date is the time of the run; equal targets give equal files.
    cairo_pdf_surface_set_metadata(
        surface.get(), CAIRO_PDF_METADATA_CREATE_DATE, "2000-01-01T00:00:00Z");
    DrawPages(surface.get(), kPoints, pages);
    cairo_surface_finish(surface.get());
    Check(cairo_surface_status(surface.get()));
  }
  return text;
}

// cairo does not state how large a pixel is, without which nobody prints at true scale.
std::string PhysicalSizeChunk(double dpi) {
  const auto bytes = [](std::uint32_t value) {
    std::string text;
    for (const unsigned shift : {24U, 16U, 8U, 0U})
      text += static_cast<char>(value >> shift & 0xFFU);
    return text;
  };
  const auto per_metre = static_cast<std::uint32_t>(std::lround(dpi / kInch * kMillimetres));
  const std::string chunk = "pHYs" + bytes(per_metre) + bytes(per_metre) + '\x01';
  const auto* data = reinterpret_cast<const Bytef*>(chunk.data());
  return bytes(9) + chunk +
         bytes(static_cast<std::uint32_t>(crc32(0, data, static_cast<uInt>(chunk.size()))));
}

std::string Png(const Page& page, double dpi) {
  constexpr double kMost = 30000;
  const double scale = dpi / kInch;
  if (scale * std::max(page.width, page.height) > kMost) {
    throw InputError(
        "{:.0f} x {:.0f} mm at {} dpi are more than {} pixels; lower --dpi, take a "
        "--paper or write SVG or PDF",
        page.width,
        page.height,
        dpi,
        kMost);
  }
  const Surface surface(
      cairo_image_surface_create(CAIRO_FORMAT_RGB24,
                                 static_cast<int>(std::lround(scale * page.width)),
                                 static_cast<int>(std::lround(scale * page.height))));
  DrawPages(surface.get(), scale, {page});
  std::string text;
  Check(cairo_surface_write_to_png_stream(surface.get(), Append, &text));
  constexpr size_t kAfterHeader = 8 + 25;  // signature and IHDR
  return text.insert(kAfterHeader, PhysicalSizeChunk(dpi));
}

std::optional<Paper> FindPaper(const std::string& name) {
  if (name == "fit") return std::nullopt;
  std::vector<std::string_view> names{"fit"};
  for (const Paper& paper : kPapers) {
    if (paper.name == name) return paper;
    names.push_back(paper.name);
  }
  throw InputError("--paper: no size '{}'{}", name, SuggestName(name, names));
}

std::vector<Page> LayOut(const std::vector<TargetPart>& sheets,
                         const std::vector<TargetPart>& tags,
                         const std::optional<Paper>& paper) {
  const bool loose = !sheets[0].tags.empty() && !sheets[0].one_sheet;
  bool fits = sheets.size() == 1;
  if (fits && loose && paper) {
    const Page page = EmptyPage(*paper, SizeOf(sheets[0]));
    const Eigen::Vector2d size = SizeOf(sheets[0]);
    fits = size.x() <= page.width - 2 * kMargin && size.y() <= page.height - 2 * kMargin - kFoot;
  }
  std::vector<Page> pages =
      fits ? LayOutSheet(sheets[0], paper) : LayOutTags(tags, paper.value_or(kPapers[4]));
  for (size_t i = 0; i < pages.size(); ++i) {
    std::string& name = pages[i].name;
    const std::string& label = sheets[0].label;
    name = fmt::format("{}{}{}", label, label.empty() || name.empty() ? "" : ", ", name);
    if (pages.size() > 1) name += fmt::format("   page {} of {}", i + 1, pages.size());
  }
  return pages;
}

}  // namespace
}  // namespace print

std::vector<std::filesystem::path> PrintTarget(const PrintRequest& request) {
  using namespace print;  // NOLINT(google-build-using-namespace)
  const std::string extension = request.out.extension().string();
  if (extension != ".svg" && extension != ".pdf" && extension != ".png") {
    throw InputError("{}: expected a name that ends in .svg, .pdf or .png", request.out.string());
  }
  const std::optional<Paper> paper = FindPaper(request.paper);
  const Target target = NominalTarget(ReadTarget(TargetNamed(request.target)));
  if (const std::string unknown = DoubtsAbout(target).unknown; !unknown.empty()) {
    throw InputError("{}: '{}' is unknown; state it, to print it", request.target, unknown);
  }
  const std::vector<TargetPart> sheets = DrawTarget(target);
  const std::vector<TargetPart> tags =
      sheets[0].tags.empty() ? std::vector<TargetPart>() : DrawTarget(target, Pieces::kApart);
  std::vector<Page> pages = LayOut(sheets, tags, paper);
  for (Page& page : pages) {
    for (Placed& placed : page.placed) placed.numbered = request.numbers;
  }

  OutputContents files;
  if (extension == ".pdf") {
    files.emplace_back(request.out.filename().string(), Pdf(pages));
  } else {
    for (size_t i = 0; i < pages.size(); ++i) {
      const std::string stem = request.out.stem().string();
      const std::string name = pages.size() == 1 ? stem : fmt::format("{}-{}", stem, i + 1);
      files.emplace_back(name + extension,
                         extension == ".svg" ? Svg(pages[i]) : Png(pages[i], request.dpi));
    }
  }
  return WriteOutputs(request.out, files);
}

}  // namespace plenocal
