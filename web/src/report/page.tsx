// SPDX-License-Identifier: Apache-2.0
// A page of sections, with a list of them on top.
import type { ComponentChildren, VNode } from "preact";

export interface PageSection {
  title: string;
  content: VNode;
}

const idOf = (title: string): string => title.toLowerCase().replace(/[^a-z]+/g, "-");

export function SectionPage({ subtitle, sections }: { subtitle: string; sections: (PageSection | null)[] }) {
  const shown = sections.filter((section) => section !== null);
  return (
    <>
      <header>
        <h1>{document.title}</h1>
        <p class="quiet">{subtitle}</p>
        <nav aria-label="Contents">
          {shown.map(({ title }) => (
            <a key={title} href={`#${idOf(title)}`}>
              {title}
            </a>
          ))}
        </nav>
      </header>
      <main>
        {shown.map(({ title, content }) => (
          <section key={title} id={idOf(title)}>
            <h2>{title}</h2>
            {content}
          </section>
        ))}
      </main>
    </>
  );
}

export function Figures({ small, children }: { small?: boolean; children: ComponentChildren }) {
  return <div class={small ? "figures small" : "figures"}>{children}</div>;
}

export const Note = ({ children }: { children: ComponentChildren }) => <p class="quiet note">{children}</p>;
