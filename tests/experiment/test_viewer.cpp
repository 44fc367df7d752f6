// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "framework/domain/io/base64.h"
#include "framework/domain/mesh_io.h"
#include "framework/experiment/record.h"
#include "framework/experiment/viewer.h"
#include "tests/experiment/temporary_folder.h"

namespace variform {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// A stand-in for the installed library, as long as the object lives.
class Library {
 public:
  explicit Library(bool is_there = true) {
    std::filesystem::create_directories(folder_ / "examples/js/controls");
    if (is_there) write_file(folder_ / "three.min.js", "var THREE = '</script><!-- three';");
    write_file(folder_ / "examples/js/controls/OrbitControls.js", "var controls = 1;");
    setenv("VARIFORM_THREE_JS", (folder_ / "three.min.js").c_str(), 1);
  }
  ~Library() { unsetenv("VARIFORM_THREE_JS"); }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

 private:
  TemporaryFolder folder_;
};

MeshFigure tetrahedron() {
  MeshFigure figure{.name = "deformed", .title = "beta = 0</script><b>"};
  figure.mesh.positions = (Matrix(4, 3) << 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, 4).finished();
  figure.mesh.cells = (IndexMatrix(1, 4) << 0, 1, 2, 3).finished();
  figure.cell_values = Vector::Constant(1, 1.0);
  figure.fixed_vertices = {3};
  figure.flipped_cells = {0};
  return figure;
}

MeshFigure textured() {
  MeshFigure figure{.name = "texture"};
  figure.mesh.positions = (Matrix(3, 3) << 0, 0, 0, 1, 0, 0, 0, 1, 0).finished();
  figure.mesh.cells = (IndexMatrix(1, 3) << 0, 1, 2).finished();
  figure.uv = (Matrix(4, 2) << 9, 9, 0, 0, 1, 0, 0, 1).finished();
  figure.uv_cells = (IndexMatrix(1, 3) << 1, 2, 3).finished();
  figure.check_size = 0.25;
  return figure;
}

nlohmann::json data_of(const std::string& html) {
  const std::string start = "id=\"viewer-data\">";
  const std::size_t from = html.find(start) + start.size();
  return nlohmann::json::parse(html.substr(from, html.find("</script>", from) - from));
}

template <class T>
std::vector<T> decoded(const nlohmann::json& text) {
  const std::string encoded = text.get<std::string>();
  io::Base64Decoder decoder(encoded);
  std::string bytes;
  while (const auto byte = decoder.read(1)) bytes += *byte;
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

int count_of(const std::string& text, const std::string& piece) {
  int count = 0;
  for (std::size_t i = text.find(piece); i != std::string::npos; i = text.find(piece, i + 1)) ++count;
  return count;
}

TEST(Viewer, CarriesTheDataOfThePanels) {
  const Library library;
  const nlohmann::json data =
      data_of(viewer_html({tetrahedron(), textured()}, {.direction = {0, 1, 0}, .up = {0, 0, 1}, .perspective = true}));
  EXPECT_EQ(data["camera"]["direction"], nlohmann::json::array({0.0, 1.0, 0.0}));
  EXPECT_EQ(data["camera"]["perspective"], true);
  ASSERT_EQ(data["panels"].size(), 2u);
  const nlohmann::json& tet = data["panels"][0];
  EXPECT_EQ(tet["title"], "deformed: beta = 0</script><b>");
  EXPECT_THAT(decoded<float>(tet["positions"]), ElementsAre(-1, -1, -2, 1, -1, -2, -1, 1, -2, -1, -1, 2))
      << "relative to the middle";
  EXPECT_EQ(decoded<std::uint32_t>(tet["triangles"]).size(), 12u) << "four faces";
  const auto colours = decoded<std::uint8_t>(tet["colours"]);
  ASSERT_EQ(colours.size(), 12u) << "a colour per face";
  EXPECT_EQ(colour_of(1.0), "#f8ea2f");
  for (std::size_t i = 0; i < 12; i += 3) {
    EXPECT_THAT((std::vector<int>{colours[i], colours[i + 1], colours[i + 2]}), ElementsAre(0xf8, 0xea, 0x2f));
  }
  EXPECT_EQ(tet["fixed"], nlohmann::json::array({3}));
  EXPECT_EQ(tet["flipped"].size(), 4u);
  EXPECT_FALSE(tet.contains("uv"));
  EXPECT_NEAR(tet["radius"], std::sqrt(6.0), 1e-12);
  // Two squares, 0.5 of uv, are one period of the texture.
  EXPECT_THAT(decoded<float>(data["panels"][1]["uv"]), ElementsAre(0, 0, 2, 0, 0, 2));
}

TEST(Viewer, NothingInItEndsItsScripts) {
  const Library library;
  const std::string html = viewer_html({tetrahedron(), textured()}, {});
  EXPECT_EQ(count_of(html, "<script"), count_of(html, "</script>"));
  EXPECT_EQ(count_of(html, "</script>"), 4) << "data, three.js, its controls, the viewer";
  EXPECT_THAT(html, HasSubstr("var THREE = '<\\/script><\\!-- three';"));
  EXPECT_THAT(html, HasSubstr("beta = 0\\u003c/script>"));
  EXPECT_THAT(html, Not(HasSubstr("http")));
  EXPECT_THAT(html, Not(HasSubstr("src=")));
}

TEST(Viewer, SaysWhatIsMissing) {
  {
    const Library missing(false);
    const std::string html = viewer_html({tetrahedron()}, {});
    EXPECT_THAT(html, HasSubstr("three.js is not installed"));
    EXPECT_THAT(html, Not(HasSubstr("<script")));
  }
  const Library library;
  const std::string some = viewer_html({tetrahedron(), textured()}, {}, 4);
  EXPECT_THAT(some, HasSubstr("1 figure is left out of the interactive view, which holds up to 4 triangles."));
  EXPECT_EQ(data_of(some)["panels"].size(), 1u);
  const std::string none = viewer_html({tetrahedron(), tetrahedron()}, {}, 3);
  EXPECT_THAT(none, HasSubstr("2 figures are left out"));
  EXPECT_THAT(none, Not(HasSubstr("<script")));
}

TEST(Viewer, ThereIsNoneWithoutFiguresInSpaceAndOneInTheReportOtherwise) {
  const Library library;
  MeshFigure planar = textured();
  planar.mesh.positions = Matrix(planar.mesh.positions.leftCols(2));
  EXPECT_EQ(viewer_html({planar}, {}), "");
  EXPECT_EQ(viewer_html({}, {}), "");
  Record record{.title = "t", .spatial = {tetrahedron(), textured()}};
  const std::string html = report_html(record, "unused", {});
  EXPECT_EQ(count_of(html, "var THREE"), 1) << "inlined once";
  record.spatial.clear();
  EXPECT_THAT(report_html(record, "unused", {}), Not(HasSubstr("THREE")));
}

}  // namespace
}  // namespace variform
