-- Numbers sections, figures and tables, the same in every output, and refuses a link such as [Figure 3](#fig-rates)
-- with another number: so the text can be read unprocessed, too. `prefix` in the title block stands before the numbers of
-- figures and tables; then sections have letters.
-- A theorem is numbered in its first bold words, a formula by \tag{3}\label{eq-split}; links to them are looked at, too,
-- and those into another paper: [Supplement, Figure S3](supplement.md#fig-adaptive), in print a text.
-- Gives wide tables their columns' widths. Repairs what pandoc does to \| (taken for a relation) and to && and the &
-- of cases (no space). Raises and lowers scripts in plain text.

local SHORT = 12
local LINE = 112 -- letters in a line of a wide table's print
local LONGEST_WORD = 16 -- longer ones are hyphenated; in heads, which are bold, none is
local BOLD = 1.2 -- letters of text that a letter of a head takes
local MARGIN = 2.7 -- letters that stand for the space between columns
local KINDS = { "Section", "Figure", "Table", "Theorem", "Proposition", "Lemma", "Corollary", "Conjecture" }

-- What is numbered in a paper: `names` of all by their identifiers.
local function counters(meta)
  local prefix = meta.prefix and pandoc.utils.stringify(meta.prefix) or ""
  return { prefix = prefix, names = {}, sections = {}, figures = 0, tables = 0 }
end
local own

local function number_section(header)
  if header.classes:includes("unnumbered") then return nil end
  local sections = own.sections
  for level = #sections + 1, header.level do sections[level] = 0 end
  for level = #sections, header.level + 1, -1 do sections[level] = nil end
  sections[header.level] = sections[header.level] + 1
  local number = table.concat(sections, ".")
  if own.prefix ~= "" then number = number:gsub("^%d+", function(first) return string.char(64 + first) end) end
  own.names[header.identifier] = "Section " .. number
  header.content:insert(1, pandoc.Space())
  header.content:insert(1, pandoc.Str(number))
  return header
end

local function number_caption(element, name)
  own.names[element.identifier] = name
  local first = element.caption.long[1]
  if not first then return nil end
  first.content:insert(1, pandoc.Space())
  first.content:insert(1, pandoc.Strong(name .. "."))
  return element
end

-- Every column takes its longest word; what is left is shared so that the longest cells have equally many lines.
local function share(words, cells, room)
  local few, many = 0.5, 100
  local widths = {}
  for _ = 1, 40 do
    local lines, total = (few + many) / 2, 0
    for column, word in ipairs(words) do
      widths[column] = math.max(word, cells[column] / lines)
      total = total + widths[column]
    end
    if total > room then few = lines else many = lines end
  end
  return widths
end

local function letters(text)
  local shown = text:gsub("\\%a+", "x"):gsub("[%^{}$]", "")
  return utf8.len(shown)
end

-- Of each column the longest word and the longest cell of these rows, in letters.
local function measure(rows, word_pattern, stretch, words, cells)
  for _, row in ipairs(rows) do
    for column, cell in ipairs(row.cells) do
      local text = pandoc.utils.stringify(cell.contents)
      cells[column] = math.max(cells[column] or 0, stretch * letters(text))
      words[column] = words[column] or MARGIN
      for word in text:gmatch(word_pattern) do
        words[column] = math.max(words[column], stretch * letters(word) + MARGIN)
      end
    end
  end
end

local function sum(numbers)
  local total = 0
  for _, number in ipairs(numbers) do total = total + number end
  return total
end

local function set_widths(wide)
  local heads, bodies, cells, words = {}, {}, {}, {}
  measure(wide.head.rows, "%S+", BOLD, heads, cells)
  for _, body in ipairs(wide.bodies) do measure(body.body, "[^%s/_=-]+", 1, bodies, cells) end
  if sum(cells) + MARGIN * #cells <= LINE then return end
  for longest = LONGEST_WORD, 4, -1 do
    for column in ipairs(cells) do
      words[column] = math.max(heads[column] or 0, math.min(longest, bodies[column] or 0))
    end
    if sum(words) <= LINE then break end
  end
  local widths = share(words, cells, LINE)
  for column, spec in ipairs(wide.colspecs) do
    wide.colspecs[column] = { spec[1], widths[column] / math.max(sum(widths), LINE) }
  end
end

-- For HTML the bars of norms in pairs, opening and closing; in print paper.typ sees to their spacing.
local function norm_bars(tex)
  local plain, bars = tex:gsub("\\|", "\\Vert ")
  if FORMAT == "typst" or bars % 2 == 1 or tex:find("\\left\\|") then return plain end
  return (tex:gsub("\\|(.-)\\|", "\\lVert %1\\rVert "))
end

local SCRIPTS = {
  { "%^%(([^()]*)%)", pandoc.Superscript },
  { "%^{([^{}]*)}", pandoc.Superscript },
  { "%^(%w+)", pandoc.Superscript },
  { "_{([^{}]*)}", pandoc.Subscript },
  { "_(%w+)", pandoc.Subscript },
}

-- Of 10^(−1), 10^9, u_h, ‖·‖_{-1/2} in plain text, as generated tables and sentences have them.
local function raise_and_lower(str)
  local found, rest = pandoc.Inlines({}), str.text
  while true do
    local first, last, script, make
    for _, each in ipairs(SCRIPTS) do
      local from, to, text = rest:find(each[1])
      if from and from > 1 and (not first or from < first) then first, last, script, make = from, to, text, each[2] end
    end
    if not first then break end
    found:insert(pandoc.Str(rest:sub(1, first - 1)))
    found:insert(make({ pandoc.Str(script) }))
    rest = rest:sub(last + 1)
  end
  if #found == 0 then return nil end
  if rest ~= "" then found:insert(pandoc.Str(rest)) end
  return found
end

-- A formula with its number at the right margin.
local function with_number(formula, number, label)
  local before, after = '<span class="equation" id="' .. label .. '">', '<span class="number">' .. number .. "</span></span>"
  if FORMAT == "typst" then
    before, after = '#numbered("' .. number .. '")[', (label ~= "" and " <" .. label .. ">" or "") .. "]"
  end
  return { pandoc.RawInline(FORMAT, before), formula, pandoc.RawInline(FORMAT, after) }
end

local number = {
  traverse = "topdown",
  Str = raise_and_lower,
  Link = function(link) return link, false end,
  Header = number_section,
  Figure = function(figure)
    own.figures = own.figures + 1
    return number_caption(figure, "Figure " .. own.prefix .. own.figures)
  end,
  Table = function(numbered)
    set_widths(numbered)
    if numbered.identifier == "" and #numbered.caption.long == 0 then return numbered end
    own.tables = own.tables + 1
    return number_caption(numbered, "Table " .. own.prefix .. own.tables)
  end,
  Math = function(formula)
    if FORMAT == "typst" then
      formula.text = formula.text:gsub("\\begin{cases}.-\\end{cases}", function(cases)
        return (cases:gsub("&", "&\\quad "))
      end)
    end
    local tag, label = formula.text:match("\\tag%s*{([^}]*)}"), formula.text:match("\\label%s*{([^}]*)}")
    formula.text = formula.text:gsub("%s*\\tag%s*%b{}", ""):gsub("%s*\\label%s*%b{}", "")
    formula.text = norm_bars(formula.text):gsub("&%s*&", "&&\\quad ")
    if not tag then return formula end
    if label then own.names[label] = "(" .. tag .. ")" end
    return with_number(formula, "(" .. tag .. ")", label or "")
  end,
  Div = function(div)
    local first = div.content[1]
    if not (div.classes:includes("theorem") and first and first.content) then return nil end
    local head = first.content[1]
    if head and head.t == "Strong" then own.names[div.identifier] = pandoc.utils.stringify(head):gsub("%.$", "") end
  end,
}

-- Of each other paper that is linked to, the names of what is numbered in it.
local others = {}
local function names_in(file)
  if not others[file] then
    local _, text = pandoc.mediabag.fetch(file)
    local doc, here = pandoc.read(text:gsub("<!%-%-.-%-%->", ""), "markdown"), own
    own = counters(doc.meta)
    doc:walk(number)
    others[file], own = own.names, here
  end
  return others[file]
end

local function is_name(text)
  if text:match("^%([%w.]+%)$") then return true end
  for _, kind in ipairs(KINDS) do
    if text:match("^" .. kind .. "%s%w") then return true end
  end
  return text == ""
end

-- A link ends with the name of what it leads to.
local function check(link, says, name)
  local shown = "[" .. says .. "](" .. link.target .. ")"
  if not name then error(shown .. " leads to nothing that has a number", 0) end
  if says:sub(-#name) ~= name then error(shown .. " should say " .. name, 0) end
end

-- In print a table of at most SHORT rows stays on one page, at its top or bottom.
local function kept_whole(printed)
  local rows = 0
  for _, body in ipairs(printed.bodies) do rows = rows + #body.body end
  if FORMAT ~= "typst" or rows > SHORT then return nil end
  local begin = pandoc.RawBlock("typst", "#[#set figure(placement: auto)\n#show figure: set block(breakable: false)")
  return { begin, printed, pandoc.RawBlock("typst", "]") }, false
end

local finish = {
  Table = kept_whole,
  Meta = function(meta)
    if FORMAT ~= "typst" then return nil end
    local date = pandoc.utils.normalize_date(pandoc.utils.stringify(meta.date or ""))
    if not date then error("the title block needs a date such as 21 November 2026", 0) end
    local year, month, day = date:match("(%d+)-0?(%d+)-0?(%d+)")
    meta.dated = { year = year, month = month, day = day }
    return meta
  end,
  Link = function(link)
    local file, aim = link.target:gsub("%.md#", "#"):match("^([%w_-]*)#(.*)$")
    if not aim then return nil end
    local says, other = pandoc.utils.stringify(link.content), file ~= ""
    if not (other or is_name(says)) then return nil end
    check(link, says, (other and names_in(file .. ".md") or own.names)[aim])
    link.content = { pandoc.Str((says:gsub(" (%S+)$", "\u{a0}%1"))) }
    if not other then return link end
    if FORMAT == "typst" then return link.content end
    link.target = file .. ".html#" .. aim
    return link
  end,
  Div = function(div)
    if FORMAT ~= "typst" then return nil end
    if div.classes:includes("proof") then
      local last = div.content[#div.content]
      if last.t == "Para" then
        last.content:insert(pandoc.RawInline("typst", "#qed"))
      else
        div.content:insert(pandoc.RawBlock("typst", "#qed"))
      end
      return div
    end
    if not div.classes:includes("theorem") then return nil end
    local label = div.identifier ~= "" and " <" .. div.identifier .. ">" or ""
    div.content:insert(1, pandoc.RawBlock("typst", "#theorem["))
    div.content:insert(pandoc.RawBlock("typst", "]" .. label))
    return div.content
  end,
}

return { { Meta = function(meta) own = counters(meta) end }, number, finish }
