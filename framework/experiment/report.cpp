// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <string>
#include <string_view>

#include "framework/domain/io/base64.h"
#include "framework/domain/io/reader.h"
#include "framework/experiment/escape.h"
#include "framework/experiment/json.h"
#include "framework/experiment/record.h"
#include "framework/experiment/viewer.h"

namespace variform {
namespace {

/// Tables of more rows scroll in a window of their own.
constexpr std::size_t kLongTable = 40;

// Forbids the page to load anything from anywhere.
constexpr std::string_view kPolicy =
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

constexpr std::string_view kStyle = R"css(
:root {
  color-scheme: light dark;
  --page: #ffffff; --text: #1f2328; --muted: #656d76; --line: #d8dee4; --tint: #f6f8fa; --link: #0a58ca;
  --holds: #1a7f37; --fails: #c3212e; --undecided: #8a6100;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #14171c; --text: #dde2e8; --muted: #949ca6; --line: #343a43; --tint: #1d2128; --link: #79b0ff;
    --holds: #4ac26b; --fails: #ff7b72; --undecided: #d8a431;
  }
}
* { box-sizing: border-box; }
body {
  max-width: 66rem; margin: 0 auto; padding: 2.5rem 1.5rem 4rem; background: var(--page); color: var(--text);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", "Helvetica Neue", "DejaVu Sans", sans-serif;
}
h1 { margin: 0 0 .3rem; font-size: 1.75rem; line-height: 1.25; font-weight: 650; letter-spacing: -.01em; }
h2 { margin: 2.6rem 0 .8rem; padding-bottom: .3rem; border-bottom: 1px solid var(--line); font-size: 1.15rem;
     font-weight: 650; }
p { margin: .3rem 0; }
a { color: var(--link); }
.muted { color: var(--muted); }
.summary { display: flex; flex-wrap: wrap; gap: .5rem 1.4rem; margin-top: 1.1rem; padding: .6rem 1rem;
           background: var(--tint); border: 1px solid var(--line); border-radius: 6px; font-size: .95rem; }
.scroll { overflow: auto; width: fit-content; max-width: 100%; margin: .4rem 0 1.6rem; border: 1px solid var(--line);
          border-radius: 6px; }
.long { max-height: 75vh; }
table { border-collapse: collapse; font-size: .875rem; font-variant-numeric: tabular-nums; }
caption { caption-side: top; padding: .55rem .8rem; color: var(--muted); text-align: left; }
th, td { padding: .38rem .8rem; border-top: 1px solid var(--line); text-align: left; vertical-align: top; }
thead th { position: sticky; top: 0; background: var(--tint); font-weight: 600; white-space: nowrap; }
table:not(:has(caption)) thead th { border-top: 0; }
tbody tr:hover { background: var(--tint); }
.number { text-align: right; white-space: nowrap; }
.sortable thead th { cursor: pointer; user-select: none; }
th[aria-sort=ascending]::after { content: " \2191"; }
th[aria-sort=descending]::after { content: " \2193"; }
.badge { display: inline-block; padding: 0 .6em; border: 1px solid; border-radius: 1em; font-size: .8rem;
         font-weight: 600; white-space: nowrap; }
.holds { color: var(--holds); } .fails { color: var(--fails); } .undecided { color: var(--undecided); }
figure { margin: 0 0 2rem; break-inside: avoid; }
figure img { display: block; max-width: 100%; height: auto; margin: 0 auto; background: #fff; border-radius: 6px; }
figcaption { margin-top: .5rem; color: var(--muted); font-size: .9rem; text-align: center; }
.viewer canvas { display: block; width: 100%; border: 1px solid var(--line); border-radius: 6px; touch-action: none; }
.controls { display: flex; flex-wrap: wrap; gap: .4rem 1.2rem; margin-bottom: .5rem; font-size: .9rem; }
.controls [hidden] { display: none; }
.animation input { flex: 1; min-width: 12rem; }
.animation output { min-width: 8rem; font-variant-numeric: tabular-nums; }
.animation button { min-width: 5rem; font: inherit; }
.controls select { max-width: 18rem; font: inherit; }
ul { margin: 0; padding-left: 1.3rem; }
code, pre { font: .84em/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
pre { overflow-x: auto; margin: 0; padding: .9rem 1rem; background: var(--tint); border: 1px solid var(--line);
      border-radius: 6px; }
pre code { font-size: inherit; }
.facts th { position: static; width: 1%; background: none; color: var(--muted); font-weight: 400; white-space: nowrap; }
.facts td { overflow-wrap: anywhere; }
.facts tr:first-child > * { border-top: 0; }
@media print {
  body { max-width: none; padding: 0; font-size: 11pt; }
  .scroll { overflow: visible; max-height: none; border: 0; }
  thead th { position: static; }
  pre { white-space: pre-wrap; }
  tr, figure { break-inside: avoid; }
}
)css";

constexpr std::string_view kScript = R"js(
for (const table of document.querySelectorAll("table.sortable")) {
  const headers = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  const sort = (header, column) => {
    const sign = header.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    headers.forEach(other => other.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const isNumber = header.classList.contains("number");
    const key = row => {
      const text = row.cells[column].dataset.value ?? row.cells[column].textContent;
      return isNumber ? (text === "" ? NaN : Number(text.replace("inf", "Infinity"))) : text;
    };
    const isBlank = value => isNumber ? Number.isNaN(value) : value === "";
    const compare = (a, b) => isBlank(a) || isBlank(b) ? isBlank(a) - isBlank(b)
        : sign * (isNumber ? (a > b) - (a < b) : a.localeCompare(b, undefined, {numeric: true}));
    [...body.rows].map(row => [key(row), row]).sort((a, b) => compare(a[0], b[0]))
        .forEach(pair => body.append(pair[1]));
  };
  headers.forEach((header, column) => {
    header.tabIndex = 0;
    header.title = "sort";
    header.addEventListener("click", () => sort(header, column));
    header.addEventListener("keydown", event => { if (event.key === "Enter") sort(header, column); });
  });
}
for (const figure of document.querySelectorAll("figure.animation")) {
  const [select, button, slider, time, image, data] =
      ["select", "button", "input", "output", "img", "script"].map(name => figure.querySelector(name));
  const points = JSON.parse(data.textContent);
  let timer = null;
  const show = () => {
    const point = points[select.value];
    slider.max = point.frames.length - 1;
    image.src = "data:image/png;base64," + point.frames[slider.value];
    time.textContent = "t = " + point.times[slider.value];
  };
  const pause = () => {
    clearInterval(timer);
    timer = null;
    button.textContent = "Play";
  };
  const step = () => {
    slider.value = Number(slider.value) + 1;
    show();
    if (slider.value === slider.max) pause();
  };
  const play = () => {
    if (slider.value === slider.max) slider.value = 0;
    show();
    timer = setInterval(step, Math.min(250, Math.max(40, 6000 / points[select.value].frames.length)));
    button.textContent = "Pause";
  };
  button.addEventListener("click", () => timer === null ? play() : pause());
  slider.addEventListener("input", () => { pause(); show(); });
  select.addEventListener("change", show);
  show();
}
)js";

std::string html(std::string_view text) {
  return escape(text, {{'&', "&amp;"}, {'<', "&lt;"}, {'>', "&gt;"}, {'"', "&quot;"}, {'\'', "&#39;"}});
}

/// A relative path as an address.
std::string address(std::string_view path) {
  static constexpr std::string_view kPlain = "-._~/";
  std::string text;
  for (const char c : path) {
    const bool is_alphanumeric = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (is_alphanumeric || kPlain.find(c) != std::string_view::npos) {
      text += c;
    } else {
      text += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
  }
  return text;
}

std::string section(std::string_view title, const std::string& content) {
  if (content.empty()) return {};
  return fmt::format("<section>\n<h2>{}</h2>\n{}</section>\n", title, content);
}

std::string badge(Verdict::Outcome outcome) {
  return fmt::format("<span class=\"badge {0}\">{0}</span>", to_string(outcome));
}

std::string counted(std::size_t count, std::string_view what) {
  return fmt::format("{} {}{}", count, what, count == 1 ? "" : "s");
}

std::string summary(const Record& record) {
  std::string items = fmt::format("<span>{}</span>\n", counted(record.rows.size(), "row"));
  if (!record.verdicts.empty()) {
    items += fmt::format("<span>{}:", counted(record.verdicts.size(), "claim"));
    const char* separator = " ";
    for (const auto outcome : {Verdict::Outcome::holds, Verdict::Outcome::fails, Verdict::Outcome::undecided}) {
      const auto count = std::count_if(record.verdicts.begin(), record.verdicts.end(),
                                       [outcome](const Verdict& verdict) { return verdict.outcome == outcome; });
      if (count == 0) continue;
      const char* const word = outcome == Verdict::Outcome::holds   ? "held"
                               : outcome == Verdict::Outcome::fails ? "failed"
                                                                    : "undecided";
      items += fmt::format("{}<strong class=\"{}\">{} {}</strong>", separator, to_string(outcome), count, word);
      separator = ", ";
    }
    items += "</span>\n";
  }
  if (!record.warnings.empty()) items += fmt::format("<span>{}</span>\n", counted(record.warnings.size(), "warning"));
  return fmt::format("<p class=\"summary\">\n{}</p>\n", items);
}

std::string claims(const std::vector<Verdict>& verdicts) {
  if (verdicts.empty()) return {};
  std::string rows;
  for (const Verdict& verdict : verdicts) {
    const std::string condition =
        verdict.condition.empty() ? "" : fmt::format("<br><code class=\"muted\">{}</code>", html(verdict.condition));
    const std::string reason =
        verdict.reason.empty() ? "" : fmt::format("<br><span class=\"muted\">{}</span>", html(verdict.reason));
    rows += fmt::format("<tr><td>{}{}</td><td>{}</td><td>{}</td><td>{}{}</td></tr>\n", html(verdict.text), condition,
                        html(verdict.published), html(verdict.ours), badge(verdict.outcome), reason);
  }
  return fmt::format(
      "<div class=\"scroll\"><table>\n"
      "<thead><tr><th>statement</th><th>published</th><th>ours</th><th>verdict</th></tr></thead>\n"
      "<tbody>\n{}</tbody>\n</table></div>\n",
      rows);
}

std::string table_html(const Table& table) {
  if (table.rows.empty() || table.columns.empty()) return {};
  std::string header;
  std::vector<const char*> classes;
  for (const Column& column : table.columns) {
    classes.push_back(is_numeric(table, column) ? " class=\"number\"" : "");
    header += fmt::format("<th{}>{}</th>", classes.back(), html(header_of(column)));
  }
  std::string rows;
  for (const Row& row : table.rows) {
    rows += "<tr>";
    for (std::size_t i = 0; i < table.columns.size(); ++i) {
      const Value* const found = row.find(table.columns[i].key);
      const Value value = found == nullptr ? Value() : *found;
      const std::string shown = to_text(value, table.columns[i].digits);
      const std::string exact = to_text(value);
      // Sorting goes by the exact number.
      const std::string data = shown == exact ? "" : fmt::format(" data-value=\"{}\"", html(exact));
      rows += fmt::format("<td{}{}>{}</td>", classes[i], data, html(shown));
    }
    rows += "</tr>\n";
  }
  const std::string caption = table.caption.empty() ? "" : fmt::format("<caption>{}</caption>\n", html(table.caption));
  return fmt::format(
      "<div class=\"scroll{}\"><table class=\"sortable\">\n{}<thead><tr>{}</tr></thead>\n<tbody>\n{}</tbody>\n"
      "</table></div>\n",
      table.rows.size() > kLongTable ? " long" : "", caption, header, rows);
}

std::string tables(const Record& record, const std::vector<std::string>& table_keys) {
  Table rows = record_table(record, table_keys);
  rows.caption.clear();  // the page has the title already
  std::string content = table_html(rows);
  for (const Table& table : record.tables) content += table_html(table);
  return content;
}

/// The width that a PNG of double resolution is shown at; its header has the width in bytes 16 to 19.
unsigned shown_width(std::string_view png) {
  if (png.size() < 20) return 0;
  unsigned width = 0;
  for (std::size_t i = 16; i < 20; ++i) width = width << 8 | static_cast<unsigned char>(png[i]);
  return width / 2;
}

std::string figures(const Record& record, const std::filesystem::path& folder) {
  std::string content;
  for (const FigureFile& figure : record.figures) {
    const std::filesystem::path png = folder / (figure.path + ".png");
    std::string picture;
    if (std::filesystem::exists(png)) {
      const std::string bytes = io::load_file(png);
      picture = fmt::format("<a href=\"{}.svg\"><img src=\"data:image/png;base64,{}\" width=\"{}\" alt=\"{}\"></a>",
                            address(figure.path), io::base64_encode(bytes), shown_width(bytes), html(figure.caption));
    } else {
      picture = fmt::format("<p class=\"muted\">{}.png was not drawn.</p>", html(figure.path));
    }
    content += fmt::format("<figure>\n{}\n<figcaption>{}</figcaption>\n</figure>\n", picture, html(figure.caption));
  }
  return content;
}

/// `most` of the numbers below count, evenly, the first and the last among them.
std::vector<std::size_t> chosen_frames(std::size_t count, std::size_t most) {
  std::vector<std::size_t> chosen;
  most = std::min(count, most);
  for (std::size_t i = 0; i < most; ++i) chosen.push_back(most == 1 ? 0 : i * (count - 1) / (most - 1));
  return chosen;
}

std::string animations(const Record& record, const std::filesystem::path& folder) {
  constexpr std::size_t kLeastFrames = 12;
  std::string content;
  for (const Animation& animation : record.animations) {
    const std::size_t share = std::max(kLeastFrames, kReportFrames / std::max<std::size_t>(1, animation.points.size()));
    const std::size_t most = std::min(share, static_cast<std::size_t>(record.max_frames));
    nlohmann::ordered_json points = nlohmann::ordered_json::array();
    std::string options;
    for (const Animation::Point& point : animation.points) {
      nlohmann::ordered_json times = nlohmann::ordered_json::array();
      nlohmann::ordered_json frames = nlohmann::ordered_json::array();
      for (const std::size_t i : chosen_frames(point.files.size(), most)) {
        const std::filesystem::path file = folder / point.files[i];
        if (!std::filesystem::exists(file)) continue;
        times.push_back(fmt::format("{:.5g}", point.times[i]));
        frames.push_back(io::base64_encode(io::load_file(file)));
      }
      if (frames.empty()) continue;
      options += fmt::format("<option value=\"{}\">{}</option>", points.size(), html(point.title));
      points.push_back({{"times", times}, {"frames", frames}});
    }
    if (points.empty()) continue;
    // The data are digits and base64: nothing in them ends the element.
    content += fmt::format(
        "<figure class=\"animation\">\n<div class=\"controls\"><select aria-label=\"point\"{}>{}</select>"
        "<button type=\"button\">Play</button><input type=\"range\" min=\"0\" value=\"0\" aria-label=\"frame\">"
        "<output></output></div>\n<img alt=\"{}\">\n<figcaption>{}</figcaption>\n"
        "<script type=\"application/json\">{}</script>\n</figure>\n",
        points.size() > 1 ? "" : " hidden", options, html(animation.caption), html(animation.caption),
        to_text(points, -1));
  }
  return content;
}

std::string warnings(const Record& record) {
  if (record.warnings.empty()) return {};
  std::string items;
  for (const std::string& warning : record.warnings) items += fmt::format("<li>{}</li>\n", html(warning));
  return fmt::format("<ul>\n{}</ul>\n", items);
}

std::string config(const Record& record) {
  return record.config.empty() ? "" : fmt::format("<pre><code>{}</code></pre>\n", html(record.config));
}

std::string provenance(const Record& record) {
  if (record.provenance.empty()) return {};
  std::string rows;
  for (const auto& [key, value] : record.provenance) {
    rows += fmt::format("<tr><th>{}</th><td>{}</td></tr>\n", html(key), html(value));
  }
  return fmt::format("<div class=\"scroll\"><table class=\"facts\">\n{}</table></div>\n", rows);
}

}  // namespace

std::string report_html(const Record& record, const std::filesystem::path& folder,
                        const std::vector<std::string>& table_keys) {
  std::string body = fmt::format("<h1>{}</h1>\n", html(record.title));
  if (!record.source.empty()) body += fmt::format("<p class=\"muted\">{}</p>\n", html(record.source));
  if (!record.pipeline.empty()) body += fmt::format("<p class=\"muted\">pipeline {}</p>\n", html(record.pipeline));
  body += summary(record);
  body += section("Claims", claims(record.verdicts));
  body += section("Tables", tables(record, table_keys));
  body += section("Interactive view", viewer_html(record.spatial, record.camera));
  body += section("Animations", animations(record, folder));
  body += section("Figures", figures(record, folder));
  body += section("Warnings", warnings(record));
  body += section("Config", config(record));
  body += section("Provenance", provenance(record));
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"{}\">\n"
      "<title>{}</title>\n<style>{}</style>\n</head>\n<body>\n{}<script>{}</script>\n</body>\n</html>\n",
      kPolicy, html(record.title), kStyle, body, kScript);
}

}  // namespace variform
