// SPDX-License-Identifier: BSD-3-Clause
#include "framework/experiment/viewer.h"

#include <Eigen/Geometry>
#include <fmt/format.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string_view>
#include <utility>

#include "framework/domain/io/base64.h"
#include "framework/domain/io/reader.h"
#include "framework/experiment/json.h"

namespace variform {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

static_assert(std::endian::native == std::endian::little, "the page reads numbers in the byte order of this machine");

constexpr std::string_view kMarkup = R"html(<div class="viewer" id="viewer">
<p class="controls">
<label>left <select></select></label>
<label>right <select></select></label>
<label><input type="checkbox"> edges</label>
<label hidden><input type="checkbox"> checkerboard</label>
<button type="button">reset view</button>
</p>
<canvas></canvas>
<p class="muted">Drag to turn, wheel to zoom, right button to move; both sides share the camera and the scale.</p>
</div>
)html";

constexpr std::string_view kScript = R"js(
(() => {
  const root = document.getElementById("viewer");
  const canvas = root.querySelector("canvas");
  const {camera: start, panels} = JSON.parse(document.getElementById("viewer-data").textContent);
  const [left, right] = root.querySelectorAll("select");
  const [edges, checks] = root.querySelectorAll("input");
  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({canvas, antialias: true});
  } catch (error) {
    canvas.replaceWith("This browser shows no WebGL.");
    return;
  }
  const decoded = (text, Type) => new Type(Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer);
  const radius = Math.max(...panels.map(panel => panel.radius)) || 1;

  // Normals of corners, averaged over the triangles at the vertex that deviate by less than 40 degrees.
  const normals_of = (positions, triangles) => {
    const count = triangles.length / 3;
    const areas = new Float32Array(triangles.length);
    const around = new Uint32Array(positions.length / 3 + 1);
    const [a, b, c] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3()];
    for (let t = 0; t < count; ++t) {
      [a, b, c].forEach((corner, k) => corner.fromArray(positions, 3 * triangles[3 * t + k]));
      b.sub(a).cross(c.sub(a)).toArray(areas, 3 * t);
      for (let k = 0; k < 3; ++k) ++around[triangles[3 * t + k] + 1];
    }
    for (let v = 1; v < around.length; ++v) around[v] += around[v - 1];
    const list = new Uint32Array(triangles.length);
    const next = around.slice();
    triangles.forEach((v, i) => { list[next[v]++] = Math.floor(i / 3); });
    const normals = new Float32Array(3 * triangles.length);
    triangles.forEach((v, i) => {
      a.fromArray(areas, 3 * Math.floor(i / 3));
      b.set(0, 0, 0);
      for (let j = around[v]; j < around[v + 1]; ++j) {
        c.fromArray(areas, 3 * list[j]);
        const agreement = a.dot(c);
        if (Math.abs(agreement) >= 0.766 * a.length() * c.length()) b.addScaledVector(c, agreement < 0 ? -1 : 1);
      }
      b.normalize().toArray(normals, 3 * i);
    });
    return normals;
  };

  const spread = (values, size, indices) => {  // one entry per corner
    const result = new values.constructor(size * indices.length);
    indices.forEach((index, i) => {
      for (let k = 0; k < size; ++k) result[size * i + k] = values[size * index + k];
    });
    return result;
  };

  const check_texture = colours => {
    const side = 64;
    const pixels = new Uint8Array(4 * side * side);
    for (let i = 0; i < side * side; ++i) {
      const odd = (i % side < side / 2) !== (i < side * side / 2);
      pixels.set([...colours[odd ? 1 : 0], 255], 4 * i);
    }
    const texture = new THREE.DataTexture(pixels, side, side, THREE.RGBAFormat);
    texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
    texture.magFilter = THREE.NearestFilter;
    texture.minFilter = THREE.LinearMipmapLinearFilter;
    texture.generateMipmaps = true;
    texture.anisotropy = renderer.capabilities.getMaxAnisotropy();
    texture.needsUpdate = true;
    return texture;
  };

  const marker_texture = shape => {
    const picture = document.createElement("canvas");
    picture.width = picture.height = 32;
    const pen = picture.getContext("2d");
    const draw = (inset, colour) => {
      pen.fillStyle = colour;
      pen.beginPath();
      if (shape === "fixed") pen.rect(inset, inset, 32 - 2 * inset, 32 - 2 * inset);
      else pen.arc(16, 16, 16 - inset, 0, 2 * Math.PI);
      pen.fill();
    };
    draw(2, shape === "soft" ? "#222" : "#fff");
    draw(7, shape === "soft" ? "#fff" : "#222");
    return new THREE.CanvasTexture(picture);
  };

  const lines_of = (positions, triangles, chosen, colour, opacity) => {
    const seen = new Set();
    const ends = [];
    const count = positions.length / 3;
    for (const t of chosen) {
      for (let k = 0; k < 3; ++k) {
        const a = triangles[3 * t + k];
        const b = triangles[3 * t + (k + 1) % 3];
        const key = Math.min(a, b) * count + Math.max(a, b);
        if (seen.has(key)) continue;
        seen.add(key);
        ends.push(a, b);
      }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(spread(positions, 3, ends), 3));
    return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({color: colour, transparent: opacity < 1, opacity}));
  };

  const scene = new THREE.Scene();
  const built = [];
  const object_of = index => {
    if (built[index]) return built[index];
    const panel = panels[index];
    const positions = decoded(panel.positions, Float32Array);
    const triangles = decoded(panel.triangles, Uint32Array);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(spread(positions, 3, triangles), 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(normals_of(positions, triangles), 3));
    const corners = Array.from(triangles, (_, i) => Math.floor(i / 3));
    const colours = spread(decoded(panel.colours, Uint8Array), 3, corners);
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3, true));
    const look = {side: THREE.DoubleSide, specular: 0x141414, shininess: 24, polygonOffset: true,
                  polygonOffsetFactor: 1, polygonOffsetUnits: 1};
    const plain = new THREE.MeshPhongMaterial({...look, vertexColors: THREE.VertexColors});
    let textured = plain;
    if (panel.uv) {
      geometry.setAttribute("uv", new THREE.BufferAttribute(decoded(panel.uv, Float32Array), 2));
      textured = new THREE.MeshPhongMaterial({...look, map: check_texture(panel.checks)});
    }
    const mesh = new THREE.Mesh(geometry, plain);
    const all = Array.from({length: triangles.length / 3}, (_, t) => t);
    const object = new THREE.Group();
    object.add(mesh);
    let wires = null;
    if (panel.flipped.length) object.add(lines_of(positions, triangles, panel.flipped, 0xe6001a, 1));
    for (const shape of ["fixed", "moved", "soft"]) {
      if (!panel[shape].length) continue;
      const points = new THREE.BufferGeometry();
      points.setAttribute("position", new THREE.BufferAttribute(spread(positions, 3, panel[shape]), 3));
      object.add(new THREE.Points(points, new THREE.PointsMaterial({
        size: 8 * Math.min(window.devicePixelRatio, 2), sizeAttenuation: false, map: marker_texture(shape), alphaTest: 0.5})));
    }
    object.update = () => {
      mesh.material = checks.checked ? textured : plain;
      if (edges.checked && !wires) object.add(wires = lines_of(positions, triangles, all, 0x000000, 0.4));
      if (wires) wires.visible = edges.checked;
    };
    scene.add(object);
    return built[index] = object;
  };

  const eye = new THREE.Vector3(...start.direction).normalize();
  const camera = start.perspective ? new THREE.PerspectiveCamera(1, 1, 0.01 * radius, 100 * radius)
                                   : new THREE.OrthographicCamera(-1, 1, 1, -1, -100 * radius, 100 * radius);
  camera.up.set(...start.up);
  camera.position.copy(eye.multiplyScalar(5 * radius));
  camera.zoom = start.zoom;
  camera.lookAt(0, 0, 0);
  const lamp = new THREE.DirectionalLight(0xffffff, 0.58);
  lamp.position.set(-0.35, 0.45, 1);
  camera.add(lamp);
  scene.add(camera, new THREE.AmbientLight(0xffffff, 0.42));
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableKeys = false;
  controls.screenSpacePanning = true;
  controls.rotateSpeed = 0.8;
  controls.saveState();

  const render = () => {
    const sides = right.value === "" ? [left.value] : [left.value, right.value];
    const width = root.clientWidth;
    const height = Math.round(Math.min(0.62 * width, 0.8 * window.innerHeight, 560));
    const each = width / sides.length;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height);
    const aspect = each / height;
    const half = 1.08 * radius / Math.min(1, aspect);
    if (start.perspective) {
      camera.aspect = aspect;
      camera.fov = 2 * 180 / Math.PI * Math.asin(Math.min(0.9, half / (5 * radius)));
    } else {
      [camera.left, camera.right, camera.top, camera.bottom] = [-half * aspect, half * aspect, half, -half];
    }
    camera.updateProjectionMatrix();
    renderer.setScissorTest(true);
    renderer.setClearColor(0xffffff);
    sides.forEach((side, i) => {
      const wanted = object_of(Number(side));
      built.forEach(object => { object.visible = object === wanted; });
      wanted.update();
      renderer.setViewport(i * each, 0, each, height);
      renderer.setScissor(i * each + (i ? 1 : 0), 0, each, height);
      renderer.render(scene, camera);
    });
  };

  panels.forEach((panel, i) => [left, right].forEach(select => select.add(new Option(panel.title, i))));
  right.add(new Option("none", ""), 0);
  left.value = "0";
  right.value = panels.length > 1 ? "1" : "";
  edges.checked = panels.every(panel => panel.edges);
  if (panels.some(panel => panel.uv)) {
    checks.parentElement.hidden = false;
    checks.checked = true;
  }
  root.querySelectorAll("select, input").forEach(control => control.addEventListener("change", render));
  root.querySelector("button").addEventListener("click", () => controls.reset());
  controls.addEventListener("change", render);
  window.addEventListener("resize", render);
  render();
})();
)js";

/// JavaScript that may stand inside a script element: nothing in it ends the element or opens a comment there. These
/// pieces occur in strings and regular expressions only, where the backslash changes nothing.
std::string inlined(std::string script) {
  for (const auto& [from, to] : {std::pair("</s", "<\\/s"), std::pair("</S", "<\\/S"), std::pair("<!--", "<\\!--")}) {
    for (std::size_t i = script.find(from); i != std::string::npos; i = script.find(from, i))
      script.replace(i, 2, to, 3);
  }
  return script;
}

/// three.js and its controls; nothing if either is missing.
std::optional<std::string> library(fs::path& looked_at) {
  const char* const given = std::getenv("VARIFORM_THREE_JS");
  looked_at = given != nullptr ? given : VARIFORM_THREE_JS;
  const fs::path controls = looked_at.parent_path() / "examples/js/controls/OrbitControls.js";
  std::string scripts;
  for (const fs::path& file : {looked_at, controls}) {
    std::error_code unreadable;
    if (!fs::is_regular_file(file, unreadable)) return std::nullopt;
    scripts += fmt::format("<script>{}</script>\n", inlined(io::load_file(file)));
  }
  return scripts;
}

template <class T>
std::string base64(const std::vector<T>& values) {
  return io::base64_encode({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)});
}

std::uint8_t byte(float channel) { return static_cast<std::uint8_t>(std::lround(255.0f * channel)); }

Json panel_json(const MeshFigure& figure, const Surface& surface) {
  // Relative to its middle, a mesh keeps its digits in single precision.
  Eigen::AlignedBox3d box;
  for (const Index v : surface.triangles.reshaped()) box.extend(Eigen::Vector3d(figure.mesh.positions.row(v)));
  const Eigen::Vector3d centre = box.isEmpty() ? Eigen::Vector3d::Zero() : Eigen::Vector3d(box.center());
  std::vector<float> positions;
  for (Index v = 0; v < figure.mesh.vertex_count(); ++v) {
    for (int k = 0; k < 3; ++k) {
      const double value = figure.mesh.positions(v, k) - centre[k];
      positions.push_back(std::isfinite(value) ? static_cast<float>(value) : 0.0f);
    }
  }
  std::vector<std::uint32_t> triangles;
  std::vector<std::uint8_t> colours;
  std::vector<float> uv;
  std::vector<char> is_flipped(static_cast<std::size_t>(figure.mesh.cell_count()), 0);
  for (const Index c : figure.flipped_cells) is_flipped[static_cast<std::size_t>(c)] = 1;
  Json flipped = Json::array();
  const double check_size = figure.check_size > 0.0 ? figure.check_size : common_check_size({figure});
  for (std::size_t t = 0; t < surface.cells.size(); ++t) {
    const Index c = surface.cells[t];
    const Rgb colour = figure.cell_values.size() > 0 ? colour_on(figure.scale, figure.cell_values[c]) : plain_colour();
    for (int k = 0; k < 3; ++k) {
      const Index v = surface.triangles(static_cast<Eigen::Index>(t), k);
      triangles.push_back(static_cast<std::uint32_t>(v));
      colours.push_back(byte(colour[k]));
      if (figure.uv.size() == 0) continue;
      // The picture of the texture holds two squares a side.
      const auto at = figure.uv.row(figure.uv_cells.size() > 0 ? figure.uv_cells(c, k) : v) / (2.0 * check_size);
      for (int i = 0; i < 2; ++i) uv.push_back(std::isfinite(at[i]) ? static_cast<float>(at[i]) : 0.0f);
    }
    if (is_flipped[static_cast<std::size_t>(c)]) flipped.push_back(t);
  }
  std::string title = figure.name;
  if (!figure.title.empty()) title += (title.empty() ? "" : ": ") + figure.title;
  if (title.empty()) title = "result";
  const auto finite = [&figure](const std::vector<Index>& vertices) {
    Json kept = Json::array();
    for (const Index v : vertices) {
      if (figure.mesh.positions.row(v).allFinite()) kept.push_back(v);
    }
    return kept;
  };
  Json json = {{"title", title},
               {"radius", box.isEmpty() ? 0.0 : 0.5 * box.diagonal().norm()},
               {"edges", figure.edges && surface.cells.size() <= 60000},
               {"positions", base64(positions)},
               {"triangles", base64(triangles)},
               {"colours", base64(colours)},
               {"flipped", flipped},
               {"fixed", finite(figure.fixed_vertices)},
               {"moved", finite(figure.moved_vertices)},
               {"soft", finite(figure.soft_vertices)}};
  if (!uv.empty()) {
    json["uv"] = base64(uv);
    json["checks"] = Json::array();
    for (const Rgb& colour : kCheckColours) {
      json["checks"].push_back({byte(colour[0]), byte(colour[1]), byte(colour[2])});
    }
  }
  return json;
}

std::string sentence(const std::string& text) { return fmt::format("<p class=\"muted\">{}</p>\n", text); }

}  // namespace

std::string viewer_html(const std::vector<MeshFigure>& figures, const Camera& camera, std::size_t most_triangles) {
  Json panels = Json::array();
  std::size_t count = 0;
  std::size_t left_out = 0;
  for (const MeshFigure& figure : figures) {
    if (!figure.is_spatial()) continue;
    const Surface surface = surface_of(figure.mesh);
    if (count + surface.cells.size() > most_triangles) {
      ++left_out;
      continue;
    }
    count += surface.cells.size();
    panels.push_back(panel_json(figure, surface));
  }
  if (panels.empty() && left_out == 0) return {};
  std::string content;
  if (left_out > 0) {
    content += sentence(fmt::format("{} figure{} left out of the interactive view, which holds up to {} triangles.",
                                    left_out, left_out == 1 ? " is" : "s are", most_triangles));
  }
  if (panels.empty()) return content;
  fs::path looked_at;
  const std::optional<std::string> scripts = library(looked_at);
  if (!scripts) {
    return content + sentence(
                         "There is no interactive view: three.js is not installed (Debian package libjs-three, or a "
                         "path in the environment variable VARIFORM_THREE_JS).");
  }
  const auto vector = [](const Eigen::Vector3d& v) { return Json{v.x(), v.y(), v.z()}; };
  const Json data = {{"camera",
                      {{"direction", vector(camera.direction)},
                       {"up", vector(camera.up)},
                       {"zoom", camera.zoom},
                       {"perspective", camera.perspective}}},
                     {"panels", panels}};
  std::string text = to_text(data, -1);
  // "<" occurs in strings only; written by its number it cannot end the element.
  for (std::size_t i = text.find('<'); i != std::string::npos; i = text.find('<', i)) text.replace(i, 1, "\\u003c");
  return content + std::string(kMarkup) +
         fmt::format("<script type=\"application/json\" id=\"viewer-data\">{}</script>\n{}<script>{}</script>\n", text,
                     *scripts, kScript);
}

fs::path viewer_library() {
  fs::path looked_at;
  return library(looked_at) ? looked_at : fs::path();
}

}  // namespace variform
