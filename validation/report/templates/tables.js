"use strict";
// Tables that sort at their heads and, where they are long, filter; a link to a row brings it into sight.
(() => {
  for (const table of document.querySelectorAll("table.cells, table.numbers")) {
    const [head, ...rows] = table.rows;
    if (rows.length < 2) continue;
    const body = head.parentNode, keys = rows.map(row => [...row.cells].map(cell => cell.textContent.trim()));
    const amount = words => { const found = /^[<>≥≤]?\s*([-+\u2212]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)/i.exec(words); return found ? +found[1].replace("\u2212", "-") : NaN; };
    [...head.cells].forEach((cell, column) => {
      const button = element("button", { type: "button", class: "sort" });
      button.append(...cell.childNodes);
      cell.append(button);
      button.addEventListener("click", () => {
        const down = cell.getAttribute("aria-sort") === "ascending" ? -1 : 1;
        for (const other of head.cells) other.removeAttribute("aria-sort");
        cell.setAttribute("aria-sort", down > 0 ? "ascending" : "descending");
        const order = rows.map((_, i) => i).sort((i, j) => {
          const [a, b] = [keys[i][column], keys[j][column]], [x, y] = [amount(a), amount(b)];
          if (Number.isNaN(x) !== Number.isNaN(y)) return Number.isNaN(x) ? 1 : -1; // dashes last, either way
          return down * (Number.isNaN(x) ? a.localeCompare(b) : x - y) || i - j;
        });
        body.append(...order.map(i => rows[i]));
      });
    });
    if (head.cells.length > 3) { // on a phone each row becomes a list of its own
      table.classList.add("stacks");
      const names = [...head.cells].map(cell => cell.textContent.replace(/\s+/g, " ").trim());
      for (const row of rows) [...row.cells].forEach((cell, column) => cell.setAttribute("data-head", names[column]));
    }
    if (rows.length <= 8) continue;
    if (rows.length > 30) table.parentNode.classList.add("long");
    const field = element("input", { type: "search", class: "filter", placeholder: "Filter rows, such as: fail", "aria-label": "Filter rows" });
    const count = element("output");
    const sift = () => {
      const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
      let kept = 0;
      rows.forEach((row, i) => {
        const text = keys[i].join(" ").toLowerCase();
        row.hidden = !words.every(word => text.includes(word));
        kept += !row.hidden;
      });
      count.textContent = `${kept} of ${rows.length}`;
    };
    field.addEventListener("input", sift);
    table.parentNode.before(element("p", { class: "sift" }, field, count));
    sift();
    addEventListener("hashchange", () => {
      const row = rows.find(one => `#${one.id}` === location.hash);
      if (!row) return;
      if (row.hidden) { field.value = ""; sift(); }
      row.scrollIntoView({ block: "center" });
    });
  }
  for (const command of document.querySelectorAll("code.copy")) {
    const button = element("button", { type: "button", class: "copier", title: "Copy this command" }, "Copy");
    button.addEventListener("click", () => {
      const range = document.createRange();
      range.selectNodeContents(command);
      getSelection().removeAllRanges();
      getSelection().addRange(range);
      button.textContent = document.execCommand("copy") ? "Copied" : "Selected"; // also where a file has no clipboard
    });
    command.after(button);
  }
})();
