// Tables sort by a click on a heading and show the rows that hold all words searched for. Also: copy buttons.

function cellKey(row, column) {
  const cell = row.cells[column];
  const number = cell.dataset.sort;
  return number === undefined ? cell.textContent.trim() : parseFloat(number.replace("inf", "Infinity"));
}

// Infinite keys (unknown, not reached) come last in both directions.
function compareKeys(a, b, falling) {
  const direction = falling ? -1 : 1;
  if (typeof a !== "number" || typeof b !== "number") return direction * String(a).localeCompare(String(b), "en", { numeric: true });
  if (a === b) return 0;
  if (a === Infinity || b === Infinity) return a === Infinity ? 1 : -1;
  return a < b ? -direction : direction;
}

function sortTable(table, column) {
  const headings = table.tHead.rows[0].cells;
  const falling = headings[column].getAttribute("aria-sort") === "ascending";
  const body = table.tBodies[0];
  const keyed = Array.from(body.rows, (row) => [cellKey(row, column), row]);
  keyed.sort((a, b) => compareKeys(a[0], b[0], falling));
  body.append(...keyed.map((pair) => pair[1]));
  for (const heading of headings) heading.setAttribute("aria-sort", "none");
  headings[column].setAttribute("aria-sort", falling ? "descending" : "ascending");
}

function filterTable(table, text, counter) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const row of table.tBodies[0].rows) {
    const content = row.textContent.toLowerCase();
    row.hidden = !words.every((word) => content.includes(word));
    shown += row.hidden ? 0 : 1;
  }
  counter.textContent = words.length ? `${shown} of ${table.tBodies[0].rows.length} rows` : `${shown} rows`;
}

async function copyCommand(button) {
  const code = button.nextElementSibling;
  try {
    await navigator.clipboard.writeText(code.textContent);
    button.textContent = "copied";
  } catch {
    getSelection().selectAllChildren(code);
    button.textContent = "selected";
  }
  setTimeout(() => { button.textContent = "copy"; }, 1500);
}

for (const table of document.querySelectorAll("table.data:not(.plain)")) {
  if (table.querySelector("tbody .empty")) continue;
  Array.from(table.tHead.rows[0].cells).forEach((heading, column) => {
    heading.querySelector("button").addEventListener("click", () => sortTable(table, column));
  });
}

for (const input of document.querySelectorAll("input[data-filter]")) {
  const table = document.getElementById(input.dataset.filter);
  const counter = document.querySelector(`[data-count="${input.dataset.filter}"]`);
  if (table.querySelector("tbody .empty")) input.disabled = true;
  input.addEventListener("input", () => filterTable(table, input.value, counter));
}

document.addEventListener("click", (event) => {
  if (event.target.matches("button.copy")) copyCommand(event.target);
});
